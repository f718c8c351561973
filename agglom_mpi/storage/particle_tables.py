"""Particles in a campaign file: those left at the end of every sample, and pictures of some.

Rows are as wide as a sample has grains, N; of each array the first `particles` places are filled.
"""

import numpy as np

from agglom_mpi.outcome import FinalParticles
from agglom_mpi.simulation.frames import Frames
from agglom_mpi.storage.columns import CRC, Column, TableSchema

_STRING = Column("string", "i8", "", "number of the string")
_SAMPLE = Column("sample", "i8", "", "number of the sample in its string, from 0")


def final_particles_layout(grains: int) -> TableSchema:
    """Layout of `/final_particles` for samples of so many grains."""
    wide = (grains,)
    return TableSchema(
        "final_particles",
        "the particles left at the end of each sample, in the first places of each array; the "
        "others are nan, or 0 grains",
        "row = string * max_samples + sample",
        (
            _STRING,
            _SAMPLE,
            Column("particles", "i8", "1", "particles left"),
            Column("radius", "f8", "m", "radii", wide),
            Column("mass", "f8", "kg", "masses", wide),
            Column("temperature", "f8", "K", "temperatures", wide),
            Column("grains", "i8", "1", "original grains in each", wide),
            CRC,
        ),
    )


def frames_layout(grains: int) -> TableSchema:
    """Layout of `/frames` for samples of so many grains."""
    wide, vectors = (grains,), (grains, 3)
    return TableSchema(
        "frames",
        "pictures of some samples of the best strings, in the first places of each array; the "
        "others are nan, 0 grains and the label -1",
        "row = a sample's place among those chosen * frames of each + frame",
        (
            _STRING,
            _SAMPLE,
            Column("frame", "i8", "", "number of the picture, from 0"),
            Column("time", "f8", "s", "when it was taken"),
            Column("particles", "i8", "1", "particles there are"),
            Column("label", "i8", "", "who is who, from frame to frame", wide),
            Column("position", "f8", "m", "centres, wrapped into the box from -D to D", vectors),
            Column("velocity", "f8", "m/s", "velocities", vectors),
            Column("radius", "f8", "m", "radii", wide),
            Column("mass", "f8", "kg", "masses", wide),
            Column("temperature", "f8", "K", "temperatures", wide),
            Column("grains", "i8", "1", "original grains in each", wide),
            CRC,
        ),
    )


_OF_FINAL = {
    "radius": "radii",
    "mass": "masses",
    "temperature": "temperatures",
    "grains": "grains",
}
_OF_FRAMES = {
    "time": "times",
    "particles": "particles",
    "label": "labels",
    "position": "positions",
    "velocity": "velocities",
    "radius": "radii",
    "mass": "masses",
    "temperature": "temperatures",
    "grains": "grains",
}


def final_row(string: int, sample: int, final: FinalParticles, grains: int) -> np.ndarray:
    """Row of `/final_particles`, shape (1,), without its checksum."""
    row = np.zeros(1, final_particles_layout(grains).dtype)
    left = len(final.radii)
    row["string"], row["sample"], row["particles"] = string, sample, left
    for column, name in _OF_FINAL.items():
        row[column] = 0 if column == "grains" else np.nan
        row[column][0, :left] = getattr(final, name)
    return row


def final_of(row: np.void) -> FinalParticles:
    """Return the particles in a row of `/final_particles`."""
    left = int(row["particles"])
    return FinalParticles(**{name: row[column][:left] for column, name in _OF_FINAL.items()})


def frame_rows(string: int, sample: int, frames: Frames) -> np.ndarray:
    """Rows of `/frames`, shape (F,), without their checksums."""
    count, grains = frames.radii.shape
    rows = np.zeros(count, frames_layout(grains).dtype)
    rows["string"], rows["sample"], rows["frame"] = string, sample, np.arange(count)
    for column, name in _OF_FRAMES.items():
        rows[column] = getattr(frames, name)
    return rows


def frames_of(rows: np.ndarray) -> Frames:
    """Return the pictures in rows of `/frames` of one sample, (F,), in order."""
    return Frames(**{name: np.array(rows[column]) for column, name in _OF_FRAMES.items()})
