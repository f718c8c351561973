"""Pictures of the best strings: which are asked for, which are there, which are missing."""

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from agglom_mpi.database.writer import CampaignWriter
from agglom_mpi.farm.chores import Chore
from agglom_mpi.farm.messages import TASK
from agglom_mpi.farm.work import Pictures, Stage
from agglom_mpi.words import counted


class Gallery(Chore):
    """What is to be stored in `/frames`, sample by sample in the order of `pictures`.

    Parameters
    ----------
    pictures
        Samples and number of frames of each.
    writer
        Of the campaign file, which may hold pictures of an earlier end of the campaign.
    parameters
        Parameter string, (10,), of a number.
    """

    def __init__(
        self,
        pictures: Pictures,
        writer: CampaignWriter,
        parameters: Callable[[int], NDArray[np.float64]],
    ) -> None:
        self._pictures = pictures
        self._writer = writer
        self._parameters = parameters
        self._places = {pair: place for place, pair in enumerate(pictures.samples)}
        wanted, stored = self._keys(), writer.frame_keys() if pictures.samples else {}
        self._same = all(wanted.get(place) == key for place, key in stored.items())
        self._missing = set(wanted)
        if self._same:
            self._missing -= stored.keys()

    @property
    def complete(self) -> bool:
        """Whether the file holds exactly what is asked for; whatever it holds if nothing is."""
        return self._same and not self._missing

    @property
    def done(self) -> bool:
        """Whether nothing more will come."""
        return not self._missing

    @property
    def stage(self) -> Stage:
        """Count the pictures that are asked for."""
        total = len(self._places) * self._pictures.frames
        return Stage(total - len(self._missing), total, "pictures")

    def open(self) -> NDArray[np.void]:
        """Drop pictures of other samples; the tasks, (n,) of `TASK`, for those that are missing."""
        if not self._same:
            self._writer.forget_frames()
            self._same = True
        count = max(1, self._pictures.frames)
        lacking = sorted({row // count for row in self._missing})
        tasks = np.zeros(len(lacking), TASK)
        for task, place in zip(tasks, lacking, strict=True):
            task["string"], task["first"] = self._pictures.samples[place]
            task["count"], task["frames"] = 1, count
            task["parameters"] = self._parameters(int(task["string"]))
        return tasks

    def announcement(self, tasks: NDArray[np.void]) -> str:
        """Say what is to be done."""
        return f"taking pictures of {counted(len(tasks), 'sample')}, {tasks['frames'][0]} of each"

    def hang(self, rows: NDArray[np.void]) -> bool:
        """Store rows of `/frames` of one sample, consecutive ones; whether all of it are there."""
        first = rows[0]
        place = self._places[int(first["string"]), int(first["sample"])]
        count = self._pictures.frames
        at = place * count + int(first["frame"])
        self._writer.put_frames(at, rows)
        self._missing -= set(range(at, at + len(rows)))
        return self._missing.isdisjoint(range(place * count, (place + 1) * count))

    def give_up(self, string: int, sample: int) -> None:
        """Expect no more of a sample that raised when it was looked at."""
        at = self._places[string, sample] * self._pictures.frames
        self._missing -= set(range(at, at + self._pictures.frames))

    def _keys(self) -> dict[int, tuple[int, int, int]]:
        count = self._pictures.frames
        return {
            place * count + frame: (*pair, frame)
            for pair, place in self._places.items()
            for frame in range(count)
        }
