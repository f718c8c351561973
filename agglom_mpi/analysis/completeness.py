"""Rows that a finished campaign has: what its status states, and what follows from other rows."""

from collections.abc import Iterable

import numpy as np

from agglom_mpi.analysis.ranking import ranks_itself, search_order
from agglom_mpi.errors import FINISHED
from agglom_mpi.formatting import pluralise
from agglom_mpi.storage.consistency import check_absent
from agglom_mpi.storage.finished import FinishedCounts
from agglom_mpi.storage.reader import CampaignData, read_campaign
from agglom_mpi.storage.schema import INVERSION
from agglom_mpi.storage.verify import Key, VerificationReport


def lacks_rows(data: CampaignData) -> bool:
    """Return whether a campaign that says it is finished lacks rows.

    `agglom check` names them, and finds more, since it decides everything again.
    """
    if data.status().state != "finished":
        return False
    report = VerificationReport(data, settled=True)
    report.generations = report.numbers("generations")
    check_absent(report)
    check_finished(report, data.frame_count)
    if not (report.losses or report.faults):
        return False
    return read_campaign(data.path).status() == data.status()  # or a run has begun meanwhile


def check_finished(report: VerificationReport, frames: int) -> None:
    """Add to a report the rows that a finished campaign lacks, which has this number of frames."""
    data = report.data
    finished = report.settled and data.status().state == "finished"
    if not finished or data.attributes.get("purpose", INVERSION) != INVERSION:
        return
    counts = FinishedCounts.of_reason(data.status().reason)
    absent = set(range(counts.generations or 0)) - report.generations
    report.add_absent("generations", absent, "though the campaign is finished")
    if not (report.lost["strings"] or report.lost["results"] or absent):  # or the order is unknown
        _check_fresh_samples(report, counts)
    lacking = (counts.frames or 0) - frames - len(report.lost["frames"])
    if lacking > 0:
        report.losses.append(f"frames: {lacking} of {counts.frames} are absent")


def _check_fresh_samples(report: VerificationReport, counts: FinishedCounts) -> None:
    """Record fresh samples that are absent.

    Where the status states no counts, as in files of earlier versions of this package, the
    campaign's text does: but only if its only leg finished, as later ones may have been asked for
    something else. Otherwise no sample may be absent between others of a string.
    """
    data = report.data
    if data.fresh_from == data.max_samples:
        return
    present = {*data.fresh_samples[["string", "sample"]].tolist(), *data.fresh_timed_out}
    ends: dict[int, int] = {}
    for string, sample in [*present, *report.lost["samples"]]:
        ends[string] = max(ends.get(string, 0), sample + 1)
    order = _estimated_first(data)
    strings, samples = counts.strings, counts.samples
    if strings is None and data.legs()["exit_code"].tolist() == [FINISHED]:
        strings, samples = _asked(data)
    if strings is None or samples is None:
        known = [string in ends for string in order]
        wanted = order[: known.index(False) if False in known else None]
        report.estimates |= _fresh(data, wanted, ends) - present
    else:
        end = min(data.fresh_from + samples, data.max_samples)
        wanted = order[:strings]
        if ranks_itself(data.identity):  # those that its last population leaves out are not known
            others = [string for string in ends if string not in wanted]
            others.sort(key=lambda string: -sum((string, j) in present for j in range(end)))
            wanted += others[: strings - len(wanted)]
            if len(wanted) < min(strings, _finite(data)):
                lacking = pluralise(strings - len(wanted), "string")
                report.losses.append(f"samples: the fresh ones of {lacking} are absent")
        report.estimates |= _fresh(data, wanted, dict.fromkeys(wanted, end)) - present
    report.add_absent("samples", report.estimates, "though their strings were estimated again")


def _fresh(data: CampaignData, strings: Iterable[int], ends: dict[int, int]) -> set[Key]:
    """Return the fresh samples of strings, as (string, sample), up to the end of each."""
    return {(string, j) for string in strings for j in range(data.fresh_from, ends[string])}


def _asked(data: CampaignData) -> tuple[int | None, int | None]:
    """Return how many strings a campaign's text asks to be estimated again, on how many samples."""
    # Imported here: most files are read without what reads a campaign's text.
    from agglom_mpi.analysis.resimulation import recorded_campaign
    from agglom_mpi.config.yaml_source import CampaignError

    try:
        final = recorded_campaign(data).final
    except CampaignError:
        return None, None
    return (0, 0) if final is None else (final.strings, final.samples)


def _decided(data: CampaignData) -> np.ndarray:
    """Return the finite results of the strings of all generations that are there."""
    strings, results = data.string_rows(), data.result_rows()
    last = max(data.generation_rows()["generation"].tolist(), default=-1)
    decided = strings["string"][strings["generation"] <= last]
    return results[np.isfinite(results["objective"]) & np.isin(results["string"], decided)]


def _finite(data: CampaignData) -> int:
    return len(_decided(data))


def _estimated_first(data: CampaignData) -> list[int]:
    """Return the strings in the order in which they are estimated again, as far as it is known.

    Of those with the same parameters, hence samples, there is the first alone.
    """
    results = _decided(data)
    order = search_order(data, results)
    if ranks_itself(data.identity):
        generations = data.generation_rows()
        population = set(generations["population"][-1].tolist()) if len(generations) else set()
        order = [string for string in order if string in population]
    distinct: dict[bytes, int] = {}
    for string in order:
        distinct.setdefault(data.parameters[string].tobytes(), string)
    return list(distinct.values())
