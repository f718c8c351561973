"""Chosen samples of a campaign file as files for ParaView, from its pictures or simulated again."""

from collections.abc import Iterator
from pathlib import Path
from typing import Final, NamedTuple

from agglom_mpi.analysis.ranking import rank_strings
from agglom_mpi.analysis.resimulation import (
    is_same,
    mistaken,
    recorded_campaign,
    recorded_parameters,
    recorded_sample,
)
from agglom_mpi.outcome import COMPLETED
from agglom_mpi.report.vtkhdf import SUFFIX, write_vtkhdf
from agglom_mpi.simulation.frames import Frames
from agglom_mpi.storage.reader import CampaignData

FRAMES: Final = 101
"""Pictures of a sample that there are none of; each hundredth of the time."""


class Choice(NamedTuple):
    """What to show; see `agglom export`.

    Attributes
    ----------
    target
        File to write; of several samples, what the names of their files begin with.
    string
        None: the best.
    samples
        If empty: those that there are pictures of, or the first that was completed.
    frames
        How many pictures to take by simulating again; None: those that are stored.
    """

    target: Path
    string: int | None = None
    samples: tuple[int, ...] = ()
    frames: int | None = None


class Shown(NamedTuple):
    """A sample that is to be shown, and the file of it."""

    string: int
    sample: int
    path: Path


def chosen(file: CampaignData, choice: Choice) -> list[Shown]:
    """Find the samples that are meant; several get their numbers in the names of their files.

    Raises
    ------
    CampaignError
        If there is no such sample, or the target has another suffix than `.vtkhdf`.
    """
    target = choice.target
    if target.suffix != SUFFIX:
        raise mistaken(target, "--paraview", f"must end in {SUFFIX}, by which ParaView knows it")
    string = _best(file) if choice.string is None else choice.string
    recorded_parameters(file, string)  # raises if there are none
    samples = list(dict.fromkeys(choice.samples))
    for sample in samples:
        recorded_sample(file, string, sample)
    samples = samples or _pictured(file, string) or [_first_completed(file, string)]
    if len(samples) == 1:
        return [Shown(string, samples[0], target)]
    return [Shown(string, k, target.with_stem(f"{target.stem}_{string}_{k}")) for k in samples]


def _best(file: CampaignData) -> int:
    order = rank_strings(file).order
    if not order:
        raise mistaken(file.path, "--string", "is missing, and none is judged yet")
    return order[0]


def _pictured(file: CampaignData, string: int) -> list[int]:
    return [sample for other, sample in file.framed() if other == string]


def _first_completed(file: CampaignData, string: int) -> int:
    rows = file.sample_rows(string)
    completed = rows["sample"][rows["state"] == COMPLETED]
    if not len(completed):
        raise mistaken(file.path, "--string", f"is {string}, of which no sample was completed")
    return int(completed[0])


def write_samples(
    file: CampaignData, samples: list[Shown], frames: int | None = None
) -> Iterator[str]:
    """Write a file for ParaView of each sample, yielding a line on each that is there.

    Parameters
    ----------
    file
        Whose samples these are.
    samples
        From `chosen`.
    frames
        As in `Choice`.

    Raises
    ------
    CampaignError
        If a sample fails.
    OSError
        As from `write_vtkhdf`.
    """
    for shown in samples:
        string, sample, path = shown
        stored = file.frames(string, sample) if frames is None else None
        if stored is None:
            seen, source = _simulated(file, shown, frames or FRAMES)
        else:
            seen, source = stored, "as stored"
        write_vtkhdf(path, seen, f"{file.attributes['title']}: string {string}, sample {sample}")
        megabytes = f"{path.stat().st_size / 1e6:.3g} MB"
        pictures = f"{len(seen.times)} pictures to {seen.times[-1]:.3g} s, {source}"
        yield f"{path}: string {string}, sample {sample}, {pictures}, {megabytes}"


def _simulated(file: CampaignData, shown: Shown, frames: int) -> tuple[Frames, str]:
    """Look at a sample again; its pictures, and whether it is the one that was recorded."""
    campaign, row = recorded_campaign(file), recorded_sample(file, shown.string, shown.sample)
    number = campaign.first_sample(shown.string) + shown.sample
    parameters = recorded_parameters(file, shown.string)
    try:
        outcome = campaign.simulate(parameters, number, frames=frames)
    except RuntimeError as error:
        raise mistaken(file.path, "--sample", f"cannot be shown: {error}") from error
    assert outcome.frames is not None
    agrees = is_same(row, outcome.record, file.format_version)
    same = "identical to" if agrees else "differs from"
    return outcome.frames, f"simulated again, {same} the recorded sample"
