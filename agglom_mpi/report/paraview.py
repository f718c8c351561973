"""The particles of samples at successive times, as VTKHDF files that ParaView plays."""

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Final, NamedTuple

import numpy as np

from agglom_mpi.analysis.ranking import rank_strings
from agglom_mpi.analysis.resimulation import (
    AGREEMENT,
    is_same,
    mistaken,
    recorded_parameters,
    recorded_sample,
    simulated_again,
)
from agglom_mpi.formatting import pluralise
from agglom_mpi.outcome import COMPLETED
from agglom_mpi.simulation.frames import Frames
from agglom_mpi.storage.files import atomic_file, new_file
from agglom_mpi.storage.reader import CampaignData

if TYPE_CHECKING:
    import h5py

SUFFIX: Final = ".vtkhdf"
"""Suffix of the files that ParaView opens."""

POINT_DATA: Final = {
    "radius": ("radii", "m"),
    "temperature": ("temperatures", "K"),
    "velocity": ("velocities", "m/s"),
    "spin": ("spins", "rad/s"),
    "grains": ("grains", "1"),
    "label": ("labels", ""),
}
"""Point arrays: the field of `Frames` and the unit, an attribute of the dataset."""

_VERSION: Final = (2, 0)
_CELLS: Final = ("Vertices", "Lines", "Polygons", "Strips")
_CHUNK: Final = 1 << 13
"""Particles in a chunk: 64 KiB of each number."""

FRAMES: Final = 101
"""Frames of a sample that has none stored; each hundredth of its time."""


class FrameSelection(NamedTuple):
    """The samples to write for ParaView; see `agglom export`.

    Attributes
    ----------
    target
        File to write; of several samples, what the names of their files begin with.
    string
        None: the best.
    samples
        If empty: those with stored frames, or the first that was completed.
    frames
        Number of frames to take by resimulation; None: those that are stored.
    """

    target: Path
    string: int | None = None
    samples: tuple[int, ...] = ()
    frames: int | None = None


SelectedSample = tuple[int, int, Path]
"""String and number of a sample to write for ParaView, and the path of its file."""


def select_samples(file: CampaignData, selection: FrameSelection) -> list[SelectedSample]:
    """Return the samples to write; several have their numbers in the names of their files.

    Raises
    ------
    CampaignError
        If there is no such sample, or the target has another suffix than `.vtkhdf`.
    """
    target = selection.target
    if target.suffix != SUFFIX:
        raise mistaken(target, "--paraview", f"must end in {SUFFIX}, by which ParaView knows it")
    string = selection.string
    if string is None:
        if not (order := rank_strings(file).order):
            raise mistaken(file.path, "--string", "is missing, and none is judged yet")
        string = order[0]
    recorded_parameters(file, string)  # raises if there are none
    samples = list(dict.fromkeys(selection.samples))
    for sample in samples:
        recorded_sample(file, string, sample)
    samples = samples or [sample for other, sample in file.particles.framed() if other == string]
    if not samples:
        rows = file.sample_rows(string)
        samples = rows["sample"][rows["state"] == COMPLETED][:1].tolist()
        if not samples:
            raise mistaken(file.path, "--string", f"is {string}, of which no sample was completed")
    if len(samples) == 1:
        return [(string, samples[0], target)]
    stem = f"{target.stem}_{string}"
    return [(string, k, target.with_stem(f"{stem}_{k}")) for k in samples]


def write_samples(
    file: CampaignData, samples: list[SelectedSample], frames: int | None = None
) -> Iterator[str]:
    """Write a file for ParaView of each sample, and yield a line on each that is written.

    Parameters
    ----------
    file
        The campaign file that has these samples.
    samples
        From `select_samples`.
    frames
        As in `FrameSelection`.

    Raises
    ------
    CampaignError
        If a sample fails.
    OSError
        As from `write_vtkhdf`.
    """
    for string, sample, path in samples:
        stored = file.particles.frames(string, sample) if frames is None else None
        if stored is None:
            shown, source = _resimulated(file, string, sample, frames or FRAMES)
        else:
            shown, source = stored, "as stored"
        write_vtkhdf(path, shown, f"{file.title}: string {string}, sample {sample}")
        megabytes = f"{path.stat().st_size / 1e6:.3g} MB"
        pictures = f"{pluralise(len(shown.times), 'picture')} to {shown.times[-1]:.3g} s, {source}"
        yield f"{path}: string {string}, sample {sample}, {pictures}, {megabytes}"


def _resimulated(file: CampaignData, string: int, sample: int, frames: int) -> tuple[Frames, str]:
    """Return frames of a resimulated sample, and a text on their origin."""
    try:
        outcome = simulated_again(file, string, sample, frames)
    except RuntimeError as error:
        raise mistaken(file.path, "--sample", f"cannot be shown: {error}") from error
    assert outcome.frames is not None
    agrees = is_same(recorded_sample(file, string, sample), outcome.record, file.sizes.version)
    return outcome.frames, f"simulated again, {AGREEMENT[agrees]}"


def write_vtkhdf(path: Path, frames: Frames, title: str) -> None:
    """Write frames as temporal VTKHDF `PolyData`, each particle a point and a vertex.

    The time is in s, points in m, and the point arrays are those of `POINT_DATA`, without the
    temperature or the spin where the scene has none; a `label` identifies a particle from frame to
    frame. The file has its name once it is complete.

    Parameters
    ----------
    path
        New file, `.vtkhdf`.
    frames
        F frames; each may have another number of particles.
    title
        What is shown, an attribute of the file.

    Raises
    ------
    FileExistsError
        If there is a file already.
    OSError
        If it cannot be written; nothing is left behind.
    """
    with atomic_file(path) as temporary, new_file(temporary) as (file, _):
        file.attrs["title"] = title
        root = file.create_group("VTKHDF")
        root.attrs["Version"] = np.array(_VERSION)
        root.attrs["Type"] = np.bytes_("PolyData")
        present = np.arange(frames.radii.shape[1]) < frames.particles[:, None]
        absent = set() if frames.has_temperature else {"temperature"}
        absent |= {"spin"} if frames.spins is None else set()
        shown = [name for name in POINT_DATA if name not in absent]
        root["NumberOfPoints"] = frames.particles
        _store(root, "Points", frames.positions[present], "m")
        data = root.create_group("PointData")
        for name in shown:
            field, unit = POINT_DATA[name]
            _store(data, name, getattr(frames, field)[present], unit)
        for name in _CELLS:
            count = frames.particles if name == "Vertices" else np.zeros_like(frames.particles)
            _store_cells(root.create_group(name), count)
        _store_steps(root.create_group("Steps"), frames, shown)


def _store(group: "h5py.Group", name: str, values: np.ndarray, unit: str | None = None) -> None:
    """Store values, compressed, shape (n,) or (n, 3) over all frames."""
    chunk = (min(len(values), _CHUNK), *values.shape[1:])
    dataset = group.create_dataset(
        name, data=values, chunks=chunk, compression="gzip", compression_opts=1, shuffle=True
    )
    if unit is not None:
        dataset.attrs["unit"] = unit


def _store_cells(group: "h5py.Group", count: np.ndarray) -> None:
    """Store cells of one point each; `count`, shape (F,), is their number in each frame."""
    group["NumberOfCells"] = count
    group["NumberOfConnectivityIds"] = count
    _store(group, "Offsets", np.concatenate([np.arange(n + 1) for n in count]))
    points = np.concatenate([np.arange(n) for n in count])
    if len(points):
        _store(group, "Connectivity", points)
    else:
        group["Connectivity"] = points


def _store_steps(group: "h5py.Group", frames: Frames, shown: Sequence[str]) -> None:
    """Store the times of F frames, and the offset of each in other arrays and the `shown` data."""
    count = len(frames.times)
    first = np.cumsum(frames.particles) - frames.particles
    cells = np.zeros((count, len(_CELLS)), np.int64)
    cells[:, _CELLS.index("Vertices")] = first
    group.attrs["NSteps"] = count
    group["Values"] = frames.times
    group["PartOffsets"] = np.arange(count)
    group["NumberOfParts"] = np.ones(count, np.int64)
    group["PointOffsets"] = first
    group["CellOffsets"] = cells
    group["ConnectivityIdOffsets"] = cells
    offsets = group.create_group("PointDataOffsets")
    for name in shown:
        offsets[name] = first
