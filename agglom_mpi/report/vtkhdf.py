"""The particles of one sample at successive times, as a VTKHDF file that ParaView plays."""

from pathlib import Path
from typing import TYPE_CHECKING, Final

import numpy as np

from agglom_mpi.simulation.frames import Frames
from agglom_mpi.storage.files import atomic_file, new_file

if TYPE_CHECKING:
    import h5py

SUFFIX: Final = ".vtkhdf"
"""By which ParaView knows such a file."""

POINT_DATA: Final = {
    "radius": ("radii", "m"),
    "temperature": ("temperatures", "K"),
    "velocity": ("velocities", "m/s"),
    "grains": ("grains", "1"),
    "label": ("labels", ""),
}
"""Point arrays: the field of `Frames` and the unit, an attribute of the dataset."""

_VERSION: Final = (2, 0)
_CELLS: Final = ("Vertices", "Lines", "Polygons", "Strips")
_CHUNK: Final = 1 << 13
"""Particles in a chunk: 64 KiB of each number."""


def write_vtkhdf(path: Path, frames: Frames, title: str) -> None:
    """Write frames as temporal VTKHDF `PolyData`, each particle a point and a vertex.

    The time is in s, points in m, and the point arrays are those of `POINT_DATA`. Each frame has
    the particles there are; a `label` tells who is who. The file has its name when it is whole.

    Parameters
    ----------
    path
        New file, `.vtkhdf`.
    frames
        F frames.
    title
        What is seen, an attribute of the file.

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
        there = np.arange(frames.radii.shape[1]) < frames.particles[:, None]
        root["NumberOfPoints"] = frames.particles
        _store(root, "Points", frames.positions[there], "m")
        data = root.create_group("PointData")
        for name, (field, unit) in POINT_DATA.items():
            _store(data, name, getattr(frames, field)[there], unit)
        for name in _CELLS:
            count = frames.particles if name == "Vertices" else np.zeros_like(frames.particles)
            _store_cells(root.create_group(name), count)
        _store_steps(root.create_group("Steps"), frames)


def _store(group: "h5py.Group", name: str, values: np.ndarray, unit: str | None = None) -> None:
    """Store values, compressed, shape (n,) or (n, 3) over all frames."""
    chunk = (min(len(values), _CHUNK), *values.shape[1:])
    dataset = group.create_dataset(
        name, data=values, chunks=chunk, compression="gzip", compression_opts=1, shuffle=True
    )
    if unit is not None:
        dataset.attrs["unit"] = unit


def _store_cells(group: "h5py.Group", count: np.ndarray) -> None:
    """Store cells of one point each, `count` of them in each frame, shape (F,)."""
    group["NumberOfCells"] = count
    group["NumberOfConnectivityIds"] = count
    _store(group, "Offsets", np.concatenate([np.arange(n + 1) for n in count]))
    points = np.concatenate([np.arange(n) for n in count])
    if len(points):
        _store(group, "Connectivity", points)
    else:
        group["Connectivity"] = points


def _store_steps(group: "h5py.Group", frames: Frames) -> None:
    """Store the times, and where what belongs to each begins in the other arrays."""
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
    for name in POINT_DATA:
        offsets[name] = first
