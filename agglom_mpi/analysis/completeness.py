"""Rows that a finished campaign has: what its status states, and what follows from other rows."""

import re
from typing import NamedTuple, Self

import numpy as np

from agglom_mpi.analysis.ranking import ranks_itself, search_order
from agglom_mpi.errors import FINISHED
from agglom_mpi.formatting import pluralise
from agglom_mpi.scheduling.interface import number_in_volume
from agglom_mpi.storage.consistency import check_absent
from agglom_mpi.storage.reader import CampaignData, read_campaign
from agglom_mpi.storage.recorded_campaign import code_note, recorded_campaign
from agglom_mpi.storage.schema import INVERSION, volume_table
from agglom_mpi.storage.verify import VerificationReport


class FinishedCounts(NamedTuple):
    """Numbers of rows that a finished file has; None where its status does not state one.

    The reason in `/status` is a sentence for people, which ends with these counts.
    """

    generations: int | None = None
    """All that were asked for; None if the search reached its target before."""
    strings: int | None = None
    samples: int | None = None
    """Strings that were estimated again, and fresh samples of each."""
    frames: int | None = None
    """Rows of `/frames`."""
    volumes: tuple[int, ...] = ()
    """Larger control volumes in which they were estimated, too; empty if there are none."""

    @classmethod
    def of_reason(cls, reason: str) -> Self:
        """Return the counts that a reason states."""
        generations = re.match(r"all (\d+) generations are|the (1) generation is", reason)
        fresh = re.search(r"; estimated again: (\d+|none)(?: strings? on (\d+) fresh)?", reason)
        frames = re.search(r"; (\d+) frames? stored", reason)
        volumes = re.search(r", volumes 1((?: \d+)+)(?=;|$)", reason)
        return cls(
            int(generations[1] or generations[2]) if generations else None,
            int(fresh[1].replace("none", "0")) if fresh else None,
            int(fresh[2] or 0) if fresh else None,
            int(frames[1]) if frames else None,
            tuple(map(int, volumes[1].split())) if volumes else (),
        )


def finished_reason(
    reason: str,
    strings: int,
    samples: int,
    frames: int,
    room: int = 0,
    volumes: tuple[int, ...] = (),
) -> str:
    """Return why a search ended, and what was stored after its end, as `/status` has it.

    Parameters
    ----------
    reason
        The first part.
    strings, samples
        Strings that were estimated again, and fresh samples of each; 0 if none were.
    frames
        Rows of `/frames`.
    room
        Fresh samples of each string that there is room for.
    volumes
        Larger control volumes in which they were estimated again, too.
    """
    if strings and samples:
        again = pluralise(strings, "string")
        reason += f"; estimated again: {again} on {pluralise(samples, 'fresh sample')}"
        reason += " each" if strings > 1 else ""
        reason += f", volumes {' '.join(map(str, (1, *volumes)))}" if volumes else ""
    elif room:
        reason += "; estimated again: none"
    return f"{reason}; {pluralise(frames, 'frame')} stored" if frames else reason


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


def damage_lines(data: CampaignData) -> list[str]:
    """Return a line if rows are damaged, hence left out, or absent from a finished campaign."""
    what = f"{pluralise(data.damaged, 'damaged row')} left out" if data.damaged else ""
    what = what or ("is finished, but rows are absent" if lacks_rows(data) else "")
    return [f"{data.path}: {what}; agglom check {data.path} says which"] if what else []


def check_finished(report: VerificationReport, frames: int) -> None:
    """Add to a report the rows that a finished campaign lacks, which has this number of frames."""
    data = report.data
    finished = report.settled and data.status().state == "finished"
    if not finished or data.attributes.get("purpose", INVERSION) != INVERSION:
        return
    counts = FinishedCounts.of_reason(data.status().reason)
    absent = set(range(counts.generations or 0)) - report.generations
    report.add_absent("generations", absent, "though the campaign is finished")
    unknown = report.lost["strings"] or report.lost["results"] or absent or code_note(data)
    if not unknown:  # else the order of strings is not known
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
    present = _fresh_numbers(data)
    order = _estimated_first(data)
    strings, samples = counts.strings, counts.samples
    if strings is None and data.legs()["exit_code"].tolist() == [FINISHED]:
        strings, samples = _asked(data)
    if strings is None or samples is None:
        known = [string in present for string in order]
        wanted = order[: known.index(False) if False in known else None]
        ends = {string: int(present[string].max()) + 1 for string in wanted}
    else:
        wanted = order[:strings]
        if ranks_itself(data):  # those that its last population leaves out are not known
            others = [string for string in present if string not in wanted]
            others.sort(key=lambda string: -len(present[string]))
            wanted += others[: strings - len(wanted)]
            if (lacking := min(strings, len(_decided(data))) - len(wanted)) > 0:
                fresh = f"the fresh ones of {pluralise(lacking, 'string')}"
                report.losses.append(f"samples: {fresh} are absent")
        ends = dict.fromkeys(wanted, min(data.fresh_from + samples, data.max_samples))
    for string, end in ends.items():
        numbers = np.arange(data.fresh_from, end)
        absent = np.setdiff1d(numbers, present.get(string, numbers[:0]))
        report.estimates |= {(string, number) for number in absent.tolist()}
    report.add_absent("samples", report.estimates, "though their strings were estimated again")
    for volume in set(counts.volumes) & set(data.volumes):
        _check_volume(report, volume, ends)


def _check_volume(report: VerificationReport, volume: int, ends: dict[int, int]) -> None:
    """Record absent samples of a larger volume: strings have as many as in the campaign's own.

    `ends` are the numbers after the last fresh sample of each string.
    """
    data, name = report.data, volume_table(volume)
    present = set(map(tuple, data.fresh_keys.tolist()))
    wanted = {(string, k) for string, end in ends.items() for k in range(data.fresh_from, end)}
    absent = {(i, k) for i, k in wanted if (number_in_volume(i, volume), k) not in present}
    report.add_absent(name, absent, "though their strings were estimated in that volume")


def _fresh_numbers(data: CampaignData) -> dict[int, np.ndarray]:
    """Return the numbers of the fresh samples of each string that has any."""
    rows = data.fresh_samples
    late = np.array([*data.fresh_timed_out], np.int64).reshape(-1, 2)
    strings = np.concatenate([rows["string"], late[:, 0]])
    order = np.argsort(strings, kind="stable")
    numbers = np.concatenate([rows["sample"], late[:, 1]])[order]
    found, first = np.unique(strings[order], return_index=True)
    return (
        dict(zip(found.tolist(), np.split(numbers, first[1:]), strict=True)) if len(found) else {}
    )


def _asked(data: CampaignData) -> tuple[int | None, int | None]:
    """Return how many strings a campaign's text asks to be estimated again, on how many samples."""
    # Imported here: most files are read without what reads a campaign's text.
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


def _estimated_first(data: CampaignData) -> list[int]:
    """Return the strings in the order in which they are estimated again, as far as it is known.

    Of those with the same parameters, hence samples, there is the first alone.
    """
    results = _decided(data)
    order = search_order(data, results)
    if ranks_itself(data):
        generations = data.generation_rows()
        population = set(generations["population"][-1].tolist()) if len(generations) else set()
        order = [string for string in order if string in population]
    distinct: dict[bytes, int] = {}
    for string in order:
        distinct.setdefault(data.parameters[string].tobytes(), string)
    return list(distinct.values())
