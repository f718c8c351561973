"""Verification of a campaign file: `agglom check FILE.h5`."""

from collections.abc import Iterator
from typing import Final

from agglom_mpi.analysis.completeness import check_finished
from agglom_mpi.analysis.failed_samples import state_lines
from agglom_mpi.analysis.finite_size import describe_finite_size
from agglom_mpi.analysis.ranking import rank_strings
from agglom_mpi.analysis.replay import Replayed, replay
from agglom_mpi.errors import FAILURE, FINISHED
from agglom_mpi.formatting import pluralise, with_article
from agglom_mpi.storage.access import DamagedCampaign
from agglom_mpi.storage.consistency import check_counts, check_digests, check_numbers
from agglom_mpi.storage.recorded_campaign import code_note
from agglom_mpi.storage.schema import INVERSION
from agglom_mpi.storage.verify import VerificationReport, row_list, verify_rows

REMEDIES: Final = {
    "strings": "propose again strings",
    "samples": "simulate again",
    "results": "recompute the results of strings",
    "generations": "repeat the decisions of generations",
    "frames": "take again frames in rows",
    "status": "write again the status in row",
}
"""Remedy of a resume for lost rows, by table; rows of other tables stay lost."""


def check_file(path: str, allow_code: bool = False) -> tuple[str, int]:
    """Verify a campaign file, without writing to it; return the text to print and the exit code.

    `allow_code` as for `CampaignData`.

    Raises
    ------
    NotACampaign, OSError
        If it is none, or cannot be read.
    """
    try:
        report = verify_rows(path, allow_code)
    except DamagedCampaign as error:
        said = "no resume can read it: restore a copy, or start afresh with --output"
        return f"{error}\n  {said}", FAILURE
    check_numbers(report)
    check_finished(report, report.counts.get("frames", 0))
    check_counts(report)
    digests = check_digests(report)
    purpose = report.data.attributes.get("purpose", INVERSION)
    given = f"the strings of {with_article(purpose)} are not searched"
    left_out = code_note(report.data) if purpose == INVERSION else given
    replayed = left_out or replay(report)
    lines = [*_verified(report, digests, replayed)]
    damage = [*report.losses, *report.faults]
    if damage:
        lines = [*damage, *_remedies(report), *lines]
    text = "\n  ".join([f"{path}: {'damaged' if damage else 'sound'}", *lines])
    return text, FAILURE if damage else FINISHED


def _verified(report: VerificationReport, digests: int, replayed: Replayed | str) -> Iterator[str]:
    names = ("strings", "results", "generations", "samples", "legs", "failures")
    rows = {name: len(report.data.rows(name)) for name in names}
    used = int(report.data.result_rows()["samples_used"].sum())
    fresh = rows["samples"] - len(report.data.searched_samples)
    kinds = f"{used} used, {fresh} fresh" if fresh else f"{used} used"
    yield (
        f"checksums: {pluralise(rows['strings'], 'string')}, "
        f"{pluralise(rows['results'], 'result')}, "
        f"{pluralise(rows['generations'], 'generation')}, {pluralise(rows['samples'], 'sample')} "
        f"({kinds}), {pluralise(rows['legs'], 'leg')} and {pluralise(rows['failures'], 'failure')} "
        "are valid"
    )
    units = {"final_particles": "final state", "frames": "frame"}
    counts = [pluralise(count, units[name]) for name, count in report.counts.items()]
    if counts:
        yield f"particles: {' and '.join(counts)} are valid"
    yield f"digests: {digests} of {pluralise(rows['generations'], 'generation')} verified"
    if isinstance(replayed, str):
        yield f"replay: left out; {replayed}"
    else:
        strings, results, generations = replayed
        yield (
            f"replay: the samples lead again to {strings} of "
            f"{pluralise(rows['strings'], 'string')}, {results} of "
            f"{pluralise(rows['results'], 'result')} and {generations} of "
            f"{pluralise(rows['generations'], 'population')}"
        )
    for volume, table in zip(report.data.volumes, report.volume_tables, strict=True):
        found = pluralise(len(report.data.rows(table)), "sample")
        yield f"volume {volume}: {found} with {volume} times the grains are valid"
    is_whole = not (report.losses or report.faults)
    if report.data.volumes and is_whole and not isinstance(replayed, str):
        yield from describe_finite_size(report.data, rank_strings(report.data).order)
    yield from state_lines(report.data)


def _remedies(report: VerificationReport) -> Iterator[str]:
    """Yield lines on what a resume would compute again, and what it would not."""
    lost, unused = dict(report.lost), report.unused_samples
    lost["samples"] = lost["samples"] - unused
    remedies = REMEDIES | dict.fromkeys(report.volume_tables, "simulate again in a larger volume")
    again = [f"{what} {row_list(lost[name])}" for name, what in remedies.items() if lost[name]]
    if again:
        yield f"a resume would {', '.join(again)}"
    if unused:
        yield f"no result rests on {row_list(unused)}: only computed again if it comes to be needed"
    if report.faults:
        yield (
            "a resume trusts every row with a right checksum and repairs nothing else: restore "
            "a copy, or start afresh with --output"
        )
