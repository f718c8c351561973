"""What `agglom check FILE.h5` says: what was verified, what is damaged, what a resume would do."""

from collections.abc import Iterator
from typing import Final

from agglom_mpi.database.access import DamagedCampaign
from agglom_mpi.database.consistency import check_digests, check_numbers
from agglom_mpi.database.contents import Contents, named
from agglom_mpi.database.integrity import read_contents
from agglom_mpi.database.schema import STUDY
from agglom_mpi.exit_codes import FAILURE, FINISHED
from agglom_mpi.farm.replay import Replayed, replay
from agglom_mpi.words import counted

AGAIN: Final = {
    "strings": "propose again strings",
    "samples": "simulate again",
    "results": "judge again strings",
    "generations": "decide again generations",
    "frames": "take again frames in rows",
}
"""What a resume does with lost rows; those of other tables stay lost."""


def check_file(path: str) -> tuple[str, int]:
    """Verify a campaign file without writing to it: the text to print and the exit code.

    Raises
    ------
    NotACampaign, OSError
        If it is none, or cannot be read.
    """
    try:
        contents = read_contents(path)
    except DamagedCampaign as error:
        said = "no resume can read it: restore a copy, or start afresh with --output"
        return f"{error}\n  {said}", FAILURE
    check_numbers(contents)
    digests = check_digests(contents)
    studied = contents.attributes.get("purpose") == STUDY
    replayed = None if studied else replay(contents)
    lines = [*_verified(contents, digests, replayed)]
    damage = [*contents.losses, *contents.faults]
    if damage:
        lines = [*damage, *_remedies(contents), *lines]
    text = "\n  ".join([f"{path}: {'damaged' if damage else 'sound'}", *lines])
    return text, FAILURE if damage else FINISHED


def _verified(contents: Contents, digests: int, replayed: Replayed | None) -> Iterator[str]:
    rows = {name: len(rows) for name, rows in contents.rows.items()}
    used = int(contents.rows["results"]["samples_used"].sum())
    fresh = rows["samples"] - len(contents.searched)
    kinds = f"{used} used, {fresh} fresh" if fresh else f"{used} used"
    yield (
        f"checksums: {counted(rows['strings'], 'string')}, {counted(rows['results'], 'result')}, "
        f"{counted(rows['generations'], 'generation')}, {counted(rows['samples'], 'sample')} "
        f"({kinds}), {counted(rows['legs'], 'leg')} and {counted(rows['failures'], 'failure')} "
        "are whole"
    )
    names = {"final_particles": "final state", "frames": "frame"}
    counts = [counted(contents.counts[name], names[name]) for name in contents.counts]
    if counts:
        yield f"particles: {' and '.join(counts)} are whole"
    yield f"digests: {digests} of {counted(rows['generations'], 'generation')} verified"
    if replayed is None:
        yield f"replay: left out; the strings of an {STUDY} are not searched"
    else:
        yield (
            f"replay: the samples lead again to {replayed.strings} of "
            f"{counted(rows['strings'], 'string')}, {replayed.results} of "
            f"{counted(rows['results'], 'result')} and {replayed.generations} of "
            f"{counted(rows['generations'], 'population')}"
        )
    state, _, reason = contents.status
    yield f"{state}: {reason}" if reason else state


def _remedies(contents: Contents) -> Iterator[str]:
    """Say what a resume would compute again, and what it would not."""
    lost, unused = dict(contents.lost), contents.unused
    lost["samples"] = lost["samples"] - unused
    again = [f"{what} {named(lost[name])}" for name, what in AGAIN.items() if lost[name]]
    if again:
        yield f"a resume would {', '.join(again)}"
    if unused:
        yield f"no result rests on {named(unused)}: only computed again if it comes to be needed"
    if contents.faults:
        yield (
            "a resume believes all rows with right checksums, and would not mend the rest: restore "
            "a copy, or start afresh with --output"
        )
