"""Do the numbers in a campaign file agree with each other, and with the digests?"""

from collections.abc import Iterator
from typing import Any, Final

import numpy as np

from agglom_mpi.outcome import COMPLETED, FAILED, REASONS
from agglom_mpi.storage.contents import Key, VerificationReport, parameters_of, row_list
from agglom_mpi.storage.digest import generation_digest, used_samples
from agglom_mpi.storage.schema import INVERSION, LEG_CAPACITY, ORIGINS, STUDY, VARIABLE_TABLE
from agglom_mpi.storage.timeouts import timed_out
from agglom_mpi.variables import VARIABLES

EXIT_CODES: Final = (-1, 0, 1, 75)
"""What a leg can have ended with; -1 if it did not."""


def check_numbers(contents: VerificationReport) -> None:
    """Find rows that are absent although others rest on them, and numbers that cannot be."""
    if contents.attributes.get("purpose") not in (INVERSION, STUDY):
        contents.faults.append("attributes: unknown purpose")
    contents.faults += _wrong_variables(contents)
    _find_absent_strings(contents)
    _find_absent_samples(contents)
    _find_absent_of_generations(contents)
    for table, wrong, what in _out_of_range(contents):
        if wrong.any():
            rows = contents.rows[table][wrong]
            columns = ("string", "sample") if table == "samples" else ("string",)
            keys = rows[list(columns)].tolist()
            named_keys = row_list(key if len(key) == 2 else key[0] for key in keys)
            contents.faults.append(f"{table}: {what} in {named_keys}")
    for what, number in _mismatches(contents):
        contents.faults.append(f"generations: {what} in {number} does not follow from the results")
    contents.faults += _wrong_legs(contents)


def check_digests(contents: VerificationReport) -> int:
    """Compare the digests of all generations that rest on whole rows; how many are right."""
    right, wrong = 0, []
    lost = contents.lost_strings
    strings, results = contents.rows["strings"], contents.rows["results"]
    samples = used_samples(contents.rows["samples"], results)
    for row in contents.rows["generations"]:
        mine = strings[strings["generation"] == row["generation"]]
        ids = mine["string"]
        if not len(ids) or not lost.isdisjoint(range(ids[0], ids[-1] + 1)):
            continue
        digest = generation_digest(
            parameters_of(mine),
            results[np.isin(results["string"], ids)],
            samples[slice(*np.searchsorted(samples["string"], [ids[0], ids[-1] + 1]))],
            contents.format_version,
        )
        if digest == int(row["digest"]):
            right += 1
        else:
            wrong.append(int(row["generation"]))
    if wrong:
        contents.faults.append(
            f"generations: what {row_list(wrong)} rests on is not what it was: a parameter, result "
            "or used sample has been changed together with its checksum"
        )
    return right


def _wrong_variables(contents: VerificationReport) -> Iterator[str]:
    rows = contents.rows["variables"]
    names = [name.rstrip(b"\0") for name in rows["name"].tolist()]
    units = [unit.rstrip(b"\0") for unit in rows["unit"].tolist()]
    if names != [v.name.encode() for v in VARIABLES] or units != [
        v.unit.encode() for v in VARIABLES
    ]:
        yield f"{VARIABLE_TABLE.name}: other names or units than those of this program"


def _find_absent_strings(contents: VerificationReport) -> None:
    """Every string up to the last of a generation that has begun must be there."""
    stored, strings = contents.numbers("strings"), contents.rows["strings"]
    begun = strings["generation"] <= max(contents.bred["generation"].tolist(), default=0)
    last = max([*strings["string"][begun].tolist(), *contents.numbers("results")], default=-1)
    contents.miss("strings", set(range(last + 1)) - stored, "though later ones are stored")
    contents.miss("strings", contents.numbers("samples") - stored, "though they have samples")


def _find_absent_samples(contents: VerificationReport) -> None:
    samples, results = contents.rows["samples"], contents.rows["results"]
    most = int(contents.attributes["max_samples"])
    used = np.clip(results["samples_used"], 0, most)
    places = np.repeat(results["string"] * most - np.cumsum(used) + used, used)
    places += np.arange(len(places))
    gaps = np.setdiff1d(places, samples["string"] * most + samples["sample"])
    late = timed_out(contents.rows["failures"], samples)
    missing = {divmod(place, most) for place in gaps.tolist()} - late
    contents.miss("samples", missing, "though the results of their strings rest on them")
    counted = max(contents.rows["generations"]["samples_simulated"].tolist(), default=0)
    torn = [key for key in contents.lost["samples"] - missing if _is_searched(key, contents)]
    final = len(contents.searched) + len(torn) + len(missing)
    final += sum(_is_searched(key, contents) for key in late)
    if final < counted:
        contents.faults.append(
            f"samples: {counted - final} unused ones are absent; {counted} had been "
            "simulated when the last generation was stored"
        )


def _is_searched(key: Key, contents: VerificationReport) -> bool:
    """Whether decisions may see a sample."""
    return isinstance(key, tuple) and key[1] < contents.fresh_from


def _find_absent_of_generations(contents: VerificationReport) -> None:
    strings = contents.rows["strings"]
    # Those read before the results; of `recorded` some may have come since.
    stored = contents.numbers("generations") | contents.lost["generations"]
    decided = strings["generation"] <= max(stored, default=-1)
    without = set(strings["string"][decided].tolist()) - contents.numbers("results")
    contents.miss("results", without, "though the generations of their strings are stored")
    # Where ranks write their samples themselves, judgements are stored somewhat later.
    begun = contents.bred["generation"] - 1 if contents.settled else ()
    last = max([*contents.recorded, *begun], default=-1)
    if contents.settled:
        fresh = contents.rows["samples"]["sample"] >= contents.fresh_from
        again = set(contents.rows["samples"]["string"][fresh].tolist())
        without = again - contents.numbers("results")
        contents.miss("results", without, "though their strings were estimated again")
    missing = set(range(int(last) + 1)) - contents.recorded
    contents.miss("generations", missing, "though later ones have begun")


def _out_of_range(contents: VerificationReport) -> Iterator[tuple[str, Any, str]]:
    """Look for numbers that no run writes; yields table, mask of its rows, and what is wrong."""
    strings, results = contents.rows["strings"], contents.rows["results"]
    parents, most = strings["parents"], contents.fresh_from
    yield "strings", strings["origin"] >= len(ORIGINS), "unknown origin"
    unborn = (parents < -1) | (parents >= strings["string"][:, None])
    yield "strings", unborn.any(axis=1), "parents that were not there yet"
    used, failed = results["samples_used"], results["failed"]
    yield "results", (used < 1) | (used > most), "number of samples used"
    samples = used_samples(contents.rows["samples"], results)
    failures = samples["string"][samples["state"] == FAILED]
    found = np.bincount(failures, minlength=int(contents.attributes["strings"]))
    for string, _ in contents.timed_out:
        found[string] += 1
    whole = ~np.isin(results["string"], list(contents.lost_strings))
    yield "results", whole & (found[results["string"]] != failed), "number of failed samples"
    samples = contents.rows["samples"]
    yield "samples", ~np.isin(samples["state"], (COMPLETED, FAILED)), "unknown state"
    odd = (samples["reason"] > 0) != (samples["state"] == FAILED)
    yield "samples", odd | (samples["reason"] >= len(REASONS)), "reason of failure"


def _mismatches(contents: VerificationReport) -> Iterator[tuple[str, int]]:
    """Find what in a generation does not follow from results; yields that and its number."""
    strings = contents.rows["strings"]
    results = {int(row["string"]): row for row in contents.rows["results"]}
    for row in contents.rows["generations"]:
        number = int(row["generation"])
        ids = strings["string"][strings["generation"] <= number].tolist()
        if contents.lost_strings & set(range(max(ids, default=0) + 1)):
            continue  # nothing can be said
        if not set(ids) <= results.keys():
            continue
        if row["evaluations"] != len(ids):
            yield "number of strings judged", number
        used = sum(int(results[string]["samples_used"]) for string in ids)
        if not used == row["samples_used"] <= row["samples_simulated"]:
            yield "number of samples used", number
        population = row["population"].tolist()
        if not set(population) <= set(ids):
            yield "strings of the population", number
            continue
        if contents.ranked_by_model:
            continue
        worth = [(float(results[string]["objective"]), string) for string in population]
        if worth != sorted(set(worth)):
            yield "order of the population", number
        best = results[population[0]]
        stored = row["best_string"], row["best_objective"], row["best_standard_error"].tobytes()
        if stored != (population[0], best["objective"], best["standard_error"].tobytes()):
            yield "best string", number


def _wrong_legs(contents: VerificationReport) -> Iterator[str]:
    legs = contents.rows["legs"]
    ended = np.isfinite(legs["stopped"])
    odd = (legs["ranks"] < 1) | ~np.isin(legs["exit_code"], EXIT_CODES) | (legs["samples"] < 0)
    odd |= ended & (legs["exit_code"] == -1)
    if odd.any():
        yield f"legs: numbers that cannot be in {row_list(np.flatnonzero(odd).tolist())}"
    # A rank that writes its own samples may have been given up before it told of the last ones.
    gathered = (legs["database"] == b"gathered").all()
    if gathered and ended.all() and not contents.lost["legs"] and len(legs) < LEG_CAPACITY:
        simulated, stored = int(legs["samples"].sum()), len(contents.rows["samples"])
        if stored > simulated:
            yield f"legs: simulated {simulated} samples in all, but {stored} are stored"
