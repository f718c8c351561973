"""Reading a campaign file, finished or not, also while it is being written."""

import json
import os
from pathlib import Path
from typing import Any, NamedTuple

import h5py
import numpy as np

from agglom_mpi.outcome import FinalParticles
from agglom_mpi.simulation.frames import Frames
from agglom_mpi.storage.access import NotACampaign, open_file, read_attributes
from agglom_mpi.storage.particle_tables import final_of, frames_of
from agglom_mpi.storage.schema import INVERSION, fresh_from
from agglom_mpi.storage.table import Rows, Table, ValidRows, concatenated

__all__ = ["CampaignData", "NotACampaign", "Status", "read_campaign", "read_inversion"]


class Status(NamedTuple):
    """What a campaign is doing, since when (Unix time, s), and why."""

    state: str
    updated: float
    reason: str


class CampaignData:
    """What is in a campaign file now.

    Every call opens the file, reads what it needs and closes it. A row counts only if it is
    final and its checksum is right. Methods give numpy rows as they are stored (columns in
    `schema`).
    """

    def __init__(self, path: Path, attributes: dict[str, Any]) -> None:
        self.path = path
        self.attributes = attributes

    def __repr__(self) -> str:
        return f"<CampaignData {str(self.path)!r}: {self.attributes['title']}>"

    @property
    def campaign_text(self) -> str:
        """The campaign, as YAML."""
        return str(self.attributes["campaign"])

    @property
    def identity(self) -> dict[str, Any]:
        """What makes the campaign what it is."""
        return dict(json.loads(self.attributes["identity"]))

    def section(self, name: str) -> dict[str, Any]:
        """Return what the identity has of a section, nested as in the campaign's text."""
        nested: dict[str, Any] = {}
        for path, value in self.identity.items():
            first, *keys = path.split(".")
            if first == name and keys:
                inner = nested
                for key in keys[:-1]:
                    inner = inner.setdefault(key, {})
                inner[keys[-1]] = value
        return nested

    @property
    def seed(self) -> int:
        """The seed of all random streams."""
        return int(self.attributes["seed"])

    @property
    def max_samples(self) -> int:
        """Samples that there is room for of each string, fresh ones included."""
        return int(self.attributes["max_samples"])

    @property
    def fresh_from(self) -> int:
        """Number of the first fresh sample of each string: decisions see those before it alone."""
        return fresh_from(self.attributes)

    def variable_rows(self) -> np.ndarray:
        """Read the ten search variables and their box; nan bounds where one is unused."""
        with open_file(self.path, thorough=False) as file:
            return Rows(file["variables"], self.path).read_all()

    def string_rows(self) -> np.ndarray:
        """Read the strings stored so far, by number."""
        return self._rows("strings")

    def result_rows(self) -> np.ndarray:
        """Read the judgements of strings so far, by string number."""
        return self._rows("results")

    def generation_rows(self) -> np.ndarray:
        """Read the generations so far, in order."""
        return self._rows("generations")

    def sample_rows(self, string: int) -> np.ndarray:
        """Read the samples of one string so far, by number, and nothing else."""
        return self._rows("samples", string * self.max_samples, self.max_samples)

    def all_sample_rows(self) -> np.ndarray:
        """Read all samples so far, by string and number; holes are skipped."""
        with open_file(self.path, thorough=False) as file:
            return self._samples(file).rows

    def final_particles(self, string: int, sample: int) -> FinalParticles | None:
        """Read the particles left at the end of a sample; None if they were not stored."""
        with open_file(self.path, thorough=False) as file:
            if "final_particles" not in file:
                return None
            table = Table(file, "final_particles", self.path)
            place = string * self.max_samples + sample
            if not (0 <= sample < self.max_samples and 0 <= place < table.capacity):
                return None
            rows = table.read(place, 1).rows
        return final_of(rows[0]) if len(rows) else None

    def framed(self) -> list[tuple[int, int]]:
        """List string and number of the samples that there are pictures of, the best first."""
        with open_file(self.path, thorough=False) as file:
            if "frames" not in file:
                return []
            keys = self._frame_keys(file)
        return list(dict.fromkeys(keys.values()))

    def frames(self, string: int, sample: int) -> Frames | None:
        """Read the pictures of a sample; None if none were stored."""
        with open_file(self.path, thorough=False) as file:
            if "frames" not in file:
                return None
            table, keys = Table(file, "frames", self.path), self._frame_keys(file)
            places = [place for place, key in keys.items() if key == (string, sample)]
            rows = concatenated([table.read(place, 1).rows for place in places], table.dtype)
        return frames_of(rows) if len(rows) else None

    def legs(self) -> np.ndarray:
        """Read the starts of the program, in order."""
        return self._rows("legs")

    def failures(self) -> np.ndarray:
        """Read the exceptions of failed samples, in order of arrival."""
        return self._rows("failures")

    def status(self) -> Status:
        """Read what the campaign is doing."""
        with open_file(self.path, thorough=False) as file:
            row = Rows(file["status"], self.path).read_all()[0]
        return Status(row["state"].decode(), float(row["updated"]), row["reason"].decode())

    @property
    def damaged(self) -> int:
        """Rows that are marked final but have a wrong checksum; they count as absent."""
        small = ("strings", "results", "generations", "legs", "failures")
        with open_file(self.path, thorough=False) as file:
            damaged = sum(Table(file, name, self.path).read().damaged for name in small)
            return damaged + self._samples(file).damaged

    def _frame_keys(self, file: h5py.File) -> dict[int, tuple[int, int]]:
        """Read string and sample of the pictures there are, by row, and not the pictures."""
        final = np.flatnonzero(Table(file, "frames", self.path).done.read_all())
        pairs = file["frames"].fields(["string", "sample"])[:]
        return dict(zip(final.tolist(), pairs[final].tolist(), strict=True))

    def _rows(self, table: str, first: int = 0, count: int | None = None) -> np.ndarray:
        with open_file(self.path, thorough=False) as file:
            return Table(file, table, self.path).read(first, count).rows

    def _samples(self, file: h5py.File) -> ValidRows:
        """Read all samples; their done bytes only as far as there are strings."""
        strings = Table(file, "strings", self.path).end()
        return Table(file, "samples", self.path).read(0, strings * self.max_samples)


def read_campaign(path: str | os.PathLike[str]) -> CampaignData:
    """Open a campaign file for reading.

    Raises
    ------
    NotACampaign
        If it is something else, truncated, damaged or of a newer format version.
    OSError
        If it is missing or cannot be read.
    """
    path = Path(path)
    with open_file(path) as file:
        return CampaignData(path, read_attributes(file, path))


def read_inversion(path: str | os.PathLike[str]) -> CampaignData:
    """Open the file of a campaign that searched, for what only such a one has.

    Raises
    ------
    NotACampaign
        As from `read_campaign`, and if the strings are for something else.
    OSError
        If it is missing or cannot be read.
    """
    file = read_campaign(path)
    purpose = file.attributes.get("purpose", INVERSION)
    if purpose != INVERSION:
        raise NotACampaign(f"{path}: holds the samples of an {purpose}, not an inversion's")
    return file
