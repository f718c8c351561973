"""Agreement of the numbers in a campaign file with each other and with its digests."""

from collections import Counter
from collections.abc import Iterator
from typing import Any, Final

import numpy as np

from agglom_mpi.formatting import pluralise
from agglom_mpi.outcome import COMPLETED, FAILED, REASONS, FailureReason
from agglom_mpi.search.proposals import ORIGINS
from agglom_mpi.storage.schema import (
    CERTIFICATE,
    INVERSION,
    LEG_CAPACITY,
    STUDY,
    parameters_of,
    samples_schema,
)
from agglom_mpi.storage.table import generation_digest, used_samples
from agglom_mpi.storage.verify import Key, VerificationReport, row_list

EXIT_CODES: Final = (-1, 0, 1, 75)
"""Exit codes that a leg may have; -1 if it has not ended."""


def check_numbers(report: VerificationReport) -> None:
    """Add to a report: absent rows that others rest on, impossible numbers, wrong own code."""
    if report.data.attributes.get("purpose") not in (INVERSION, STUDY, CERTIFICATE):
        report.faults.append("attributes: unknown purpose")
    # Imported here: other files are verified without what reads modules.
    from agglom_mpi.config.own_components import record_faults

    report.faults += record_faults(report.data.attributes, report.data.identity)
    check_absent(report)
    for table, wrong, what in _out_of_range(report):
        if wrong.any():
            rows = report.data.rows(table)[wrong]
            columns = ("string", "sample") if table == "samples" else ("string",)
            keys = rows[list(columns)].tolist()
            keys_text = row_list(key if len(key) == 2 else key[0] for key in keys)
            report.faults.append(f"{table}: {what} in {keys_text}")
    for what, number in _mismatches(report):
        report.faults.append(f"generations: {what} in {number} does not follow from the results")
    report.faults += [*_wrong_legs(report), *_absent_texts(report)]


def check_absent(report: VerificationReport) -> None:
    """Add to a report: rows that are absent though others rest on them."""
    _find_absent_strings(report)
    _find_absent_samples(report)
    _find_absent_of_generations(report)


def check_digests(report: VerificationReport) -> int:
    """Compare the digests of all generations that rest on valid rows; return how many agree."""
    right, wrong = 0, []
    lost, sizes = report.lost_strings, report.data.sizes
    strings, results = report.data.string_rows(), report.data.result_rows()
    samples = report.data.all_sample_rows()
    for row in report.data.generation_rows():
        mine = strings[strings["generation"] == row["generation"]]
        ids = mine["string"]
        if not len(ids) or not lost.isdisjoint(range(ids[0], ids[-1] + 1)):
            continue
        own = slice(*np.searchsorted(samples["string"], [ids[0], ids[-1] + 1]))
        digest = generation_digest(
            parameters_of(mine),
            results[np.isin(results["string"], ids)],
            used_samples(samples[own], results),
            sizes.version,
            samples_schema(sizes.quantities, sizes.census),
        )
        if digest == int(row["digest"]):
            right += 1
        else:
            wrong.append(int(row["generation"]))
    if wrong:
        report.faults.append(
            f"generations: digest mismatch in {row_list(wrong)}: parameters, results or used "
            "samples were altered together with their checksums"
        )
    return right


def _find_absent_strings(report: VerificationReport) -> None:
    """Record absent strings: all up to the last of a generation that has begun must be there.

    A generation has begun if one of its bred strings has samples: where the disc was full, some of
    those that were to be stored together may be missing.
    """
    stored, strings, bred = (
        report.numbers("strings"),
        report.data.string_rows(),
        report.bred_strings,
    )
    tried = np.isin(bred["string"], list(report.numbers("samples") | report.numbers("results")))
    begun = strings["generation"] <= max(bred["generation"][tried].tolist(), default=0)
    last = max([*strings["string"][begun].tolist(), *report.numbers("results")], default=-1)
    report.add_absent("strings", set(range(last + 1)) - stored, "though later ones are stored")
    report.add_absent("strings", report.numbers("samples") - stored, "though they have samples")


def _find_absent_samples(report: VerificationReport) -> None:
    samples, results = report.data.all_sample_rows(), report.data.result_rows()
    most = report.data.max_samples
    used = np.clip(results["samples_used"], 0, most)
    places = np.repeat(results["string"] * most - np.cumsum(used) + used, used)
    places += np.arange(len(places))
    stored = samples["string"] * most + samples["sample"]
    gaps = np.setdiff1d(places, stored, assume_unique=True)
    timed_out = report.data.timed_out
    missing = {divmod(place, most) for place in gaps.tolist()} - timed_out
    report.add_absent("samples", missing, "though the results of their strings rest on them")
    counted = max(report.data.generation_rows()["samples_simulated"].tolist(), default=0)
    damaged = [key for key in report.lost["samples"] - missing if _is_searched(key, report)]
    searched = np.count_nonzero(samples["sample"] < report.data.fresh_from)
    final = searched + len(damaged) + len(missing)
    final += sum(_is_searched(key, report) for key in timed_out)
    if final < counted:
        report.faults.append(
            f"samples: {counted - final} unused ones are absent; {counted} had been "
            "simulated when the last generation was stored"
        )


def _is_searched(key: Key, report: VerificationReport) -> bool:
    """Return whether decisions may see a sample."""
    return isinstance(key, tuple) and key[1] < report.data.fresh_from


def _find_absent_of_generations(report: VerificationReport) -> None:
    strings = report.data.string_rows()
    # Those read before the results; of `report.generations` some may have come since.
    stored = report.numbers("generations") | report.lost["generations"]
    decided = strings["generation"] <= max(stored, default=-1)
    without = set(strings["string"][decided].tolist()) - report.numbers("results")
    report.add_absent("results", without, "though the generations of their strings are stored")
    # Where ranks write their samples themselves, results are stored somewhat later.
    begun = report.bred_strings["generation"] - 1 if report.settled else ()
    last = max([*report.generations, *begun], default=-1)
    if report.settled:
        fresh = report.data.all_sample_rows()["sample"] >= report.data.fresh_from
        again = set(report.data.all_sample_rows()["string"][fresh].tolist())
        without = again - report.numbers("results")
        report.add_absent("results", without, "though their strings were estimated again")
        judged = np.isin(strings["string"], list(report.numbers("results")))
        closed = set(strings["generation"][judged].tolist())
        closed -= {*strings["generation"][~judged].tolist(), *report.generations}
        report.add_absent("generations", closed, "though all their strings are judged")
    missing = set(range(int(last) + 1)) - report.generations
    report.add_absent("generations", missing, "though later ones have begun")


def _out_of_range(report: VerificationReport) -> Iterator[tuple[str, Any, str]]:
    """Yield table, mask of its rows, and what is wrong, of numbers that no run writes."""
    strings, results = report.data.string_rows(), report.data.result_rows()
    parents, most = strings["parents"], report.data.fresh_from
    yield "strings", strings["origin"] >= len(ORIGINS), "unknown origin"
    unborn = (parents < -1) | (parents >= strings["string"][:, None])
    yield "strings", unborn.any(axis=1), "parents that were not there yet"
    used, failed = results["samples_used"], results["failed"]
    yield "results", (used < 1) | (used > most), "number of samples used"
    samples = report.data.all_sample_rows()
    is_failed = (samples["state"] == FAILED) & report.data.are_used(samples)
    found = Counter(samples["string"][is_failed].tolist())
    found.update(string for string, _ in report.data.judged_timed_out)
    counted = np.array([found[string] for string in results["string"].tolist()], int)
    whole = ~np.isin(results["string"], list(report.lost_strings))
    yield "results", whole & (counted != failed), "number of failed samples"
    yield "samples", ~np.isin(samples["state"], (COMPLETED, FAILED)), "unknown state"
    odd = (samples["reason"] > 0) != (samples["state"] == FAILED)
    yield "samples", odd | (samples["reason"] >= len(REASONS)), "reason of failure"


def _mismatches(report: VerificationReport) -> Iterator[tuple[str, int]]:
    """Yield what in a generation does not follow from results, and the generation."""
    strings = report.data.string_rows()
    results = {int(row["string"]): row for row in report.data.result_rows()}
    for row in report.data.generation_rows():
        number = int(row["generation"])
        ids = strings["string"][strings["generation"] <= number].tolist()
        if report.lost_strings & set(range(max(ids, default=0) + 1)):
            continue  # it cannot be checked
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
        if report.ranked_by_model:
            continue
        objectives = [(float(results[string]["objective"]), string) for string in population]
        if objectives != sorted(set(objectives)):
            yield "order of the population", number
        best = results[population[0]]
        stored = row["best_string"], row["best_objective"], row["best_standard_error"].tobytes()
        if stored != (population[0], best["objective"], best["standard_error"].tobytes()):
            yield "best string", number


def _wrong_legs(report: VerificationReport) -> Iterator[str]:
    legs = report.data.legs()
    ended = np.isfinite(legs["stopped"])
    odd = (legs["ranks"] < 1) | ~np.isin(legs["exit_code"], EXIT_CODES) | (legs["samples"] < 0)
    odd |= ended & (legs["exit_code"] == -1)
    if odd.any():
        yield f"legs: impossible numbers in {row_list(np.flatnonzero(odd).tolist())}"
    if report.settled and not len(legs) and len(report.data.all_sample_rows()):
        yield "legs: there is none, though there are samples"
    # A rank that writes its own samples may be lost before it reports the last ones.
    gathered = (legs["database"] == b"gathered").all()
    if gathered and ended.all() and not report.lost["legs"] and len(legs) < LEG_CAPACITY:
        simulated = int(legs["samples"].sum())
        stored = len(report.data.all_sample_rows()) + report.data.volume_count
        if stored > simulated:
            samples = pluralise(simulated, "sample")
            yield f"legs: simulated {samples} in all, but {stored} are stored"


def _absent_texts(report: VerificationReport) -> Iterator[str]:
    """Yield which samples raised without a text in `/failures`, where all runs ended in order."""
    legs, failures = report.data.legs(), report.data.failures()
    ended = report.settled and np.isfinite(legs["stopped"]).all() and not report.lost["legs"]
    if not ended or report.lost["failures"] or len(failures) >= report.room["failures"]:
        return
    samples = report.data.all_sample_rows()
    raised = samples[samples["reason"] == FailureReason.EXCEPTION][["string", "sample"]].tolist()
    without = set(raised).difference(failures[["string", "sample"]].tolist())
    if without:
        yield f"failures: the texts of {row_list(without)} are absent"


def check_counts(report: VerificationReport) -> None:
    """Add to a report how many rows are absent by what the only leg of a file has counted.

    It comes last: where it is known which rows are lost, nothing is added. After several legs a row
    may have been lost and made again, or not asked for any more.
    """
    data, legs = report.data, report.data.legs()
    if len(legs) != 1 or not report.settled or any(report.lost.values()):
        return
    [leg] = legs
    samples = data.all_sample_rows()
    if np.isfinite(leg["stopped"]) and leg["database"] == b"gathered":
        known = len(samples) + data.volume_count + len(data.timed_out)
        lacking = int(leg["samples"]) - known
        if lacking > 0:
            report.faults.append(f"samples: {lacking} of {leg['samples']} simulated are absent")
    if "final_particles" in report.counts:
        completed = int((samples["state"] == COMPLETED).sum())
        lacking = completed - report.counts["final_particles"]
        if lacking > 0:
            report.faults.append(f"final_particles: {lacking} of {completed} are absent")
