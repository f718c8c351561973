"""Rows of `/final_particles` and `/frames`: final states of samples, and frames of some.

Arrays in a row are as long as a sample has grains; their first `particles` places are filled.
"""

from collections.abc import Callable
from contextlib import AbstractContextManager
from pathlib import Path

import h5py
import numpy as np

from agglom_mpi.outcome import FinalParticles
from agglom_mpi.simulation.frames import Frames, without_temperatures
from agglom_mpi.storage.access import open_file
from agglom_mpi.storage.rows import Rows
from agglom_mpi.storage.schema import final_particles_schema, frames_schema
from agglom_mpi.storage.table import Table, concatenated, consecutive_numbers

_OF_FINAL = {
    "radius": "radii",
    "mass": "masses",
    "temperature": "temperatures",
    "grains": "grains",
    "spin": "spins",
}
_OF_FRAMES = _OF_FINAL | {
    "time": "times",
    "particles": "particles",
    "label": "labels",
    "position": "positions",
    "velocity": "velocities",
}


def _fields_in(fields: dict[str, str], rows: np.ndarray) -> list[tuple[str, str]]:
    """Return the columns that rows have with the names of what they hold."""
    return [pair for pair in fields.items() if pair[0] in (rows.dtype.names or ())]


def final_row(string: int, sample: int, final: FinalParticles, grains: int) -> np.ndarray:
    """Return the row of `/final_particles` of a sample, (1,), without its checksum."""
    row = np.zeros(1, final_particles_schema(grains, final.spins is not None).dtype)
    left = len(final.radii)
    row["string"], row["sample"], row["particles"] = string, sample, left
    for column, name in _fields_in(_OF_FINAL, row):
        row[column] = 0 if column == "grains" else np.nan
        row[column][0, :left] = getattr(final, name)
    return row


def frame_rows(string: int, sample: int, frames: Frames) -> np.ndarray:
    """Return the rows of `/frames` of a sample, (frames,), without their checksums."""
    count, grains = frames.radii.shape
    rows = np.zeros(count, frames_schema(grains, frames.spins is not None).dtype)
    rows["string"], rows["sample"], rows["frame"] = string, sample, np.arange(count)
    for column, name in _fields_in(_OF_FRAMES, rows):
        rows[column] = getattr(frames, name)
    return rows


def frame_keys(file: h5py.File, path: Path) -> dict[int, tuple[int, int]]:
    """Read (string, sample) of each final row of `/frames`, by row, and no particles."""
    if "frames" not in file:
        return {}
    final, columns = Table(file, "frames", path).done.nonzero(), ["string", "sample"]
    runs = [slice(first, first + count) for first, count in consecutive_numbers(final)]
    pairs = [pair for run in runs for pair in file["frames"].fields(columns)[run].tolist()]
    return dict(zip(final.tolist(), pairs, strict=True))


class StoredParticles:
    """Reader of `/final_particles` and `/frames`; each call reads the file.

    Parameters
    ----------
    path
        The file.
    has_temperature
        Returns whether grains have a temperature; where no law needs one, rows hold 0 K.
    """

    def __init__(self, path: Path, has_temperature: Callable[[], bool]) -> None:
        self._path = path
        self._has_temperature = has_temperature

    def final(self, string: int, sample: int) -> FinalParticles | None:
        """Read the particles left at the end of a sample; None if they were not stored."""
        with open_file(self._path, thorough=False) as file:
            if "final_particles" not in file:
                return None
            table = Table(file, "final_particles", self._path)
            most = int(file.attrs["max_samples"])
            place = string * most + sample
            if not (0 <= sample < most and 0 <= place < table.capacity):
                return None
            rows = table.read(place, 1).rows
        if not len(rows):
            return None
        left = int(rows["particles"][0])
        columns = {name: rows[column][0][:left] for column, name in _fields_in(_OF_FINAL, rows)}
        found = FinalParticles(**columns)
        return found if self._has_temperature() else without_temperatures(found)

    def framed(self) -> list[tuple[int, int]]:
        """Read which samples, as (string, sample), there are frames of, the best string first."""
        with open_file(self._path, thorough=False) as file:
            return list(dict.fromkeys(frame_keys(file, self._path).values()))

    def frames(self, string: int, sample: int) -> Frames | None:
        """Read the frames of a sample; None if none were stored."""
        with open_file(self._path, thorough=False) as file:
            keys = frame_keys(file, self._path).items()
            places = [place for place, key in keys if key == (string, sample)]
            if not places:
                return None
            table = Table(file, "frames", self._path)
            rows = concatenated([table.read(place, 1).rows for place in places], table.dtype)
        if not len(rows):
            return None
        fields = _fields_in(_OF_FRAMES, rows)
        found = Frames(**{name: np.array(rows[column]) for column, name in fields})
        return found if self._has_temperature() else without_temperatures(found)


class FrameWriter:
    """Writer of `/frames`; rows are in the file when a method returns.

    Parameters
    ----------
    file
        The campaign file, open for writing.
    path
        Its name.
    writing
        Returns a context in which rows may be written.
    """

    def __init__(
        self, file: h5py.File, path: Path, writing: Callable[[], AbstractContextManager[None]]
    ) -> None:
        self._file = file
        self._path = path
        self._writing = writing

    def put(self, first: int, rows: np.ndarray) -> None:
        """Write frames, (n,) rows of `/frames` without `crc`, in place of those there are."""
        with self._writing():
            table = Table(self._file, "frames", self._path)
            table.mark_absent(first, len(rows))
            table.write(first, rows)

    def keys(self) -> dict[int, tuple[int, int, int]]:
        """Return (string, sample, frame) of the frames with the right checksum, by row."""
        if "frames" not in self._file:
            return {}
        table, keys = Table(self._file, "frames", self._path), {}
        for place in table.done.nonzero().tolist():  # one by one: they are large
            for row in table.read(place, 1).rows:
                keys[place] = int(row["string"]), int(row["sample"]), int(row["frame"])
        return keys

    @property
    def count(self) -> int:
        """Number of frames there are."""
        return count_frames(self._file, self._path)

    def forget(self) -> None:
        """Make all frames absent."""
        with self._writing():
            table = Table(self._file, "frames", self._path)
            table.mark_absent(0, table.capacity)


def count_frames(file: h5py.File, path: Path) -> int:
    """Return the number of final rows of `/frames`."""
    return len(Rows(file["frames_done"], path).nonzero()) if "frames" in file else 0
