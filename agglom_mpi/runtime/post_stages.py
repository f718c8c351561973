"""Stages after the search: re-estimation of the best strings, stored frames."""

from abc import ABC, abstractmethod
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from agglom_mpi.formatting import pluralise
from agglom_mpi.runtime.experiment import FramePlan, ReestimationPlan, StageProgress
from agglom_mpi.scheduling.in_flight import SampleRange
from agglom_mpi.scheduling.interface import new_tasks, number_in_volume, volume_string
from agglom_mpi.scheduling.static_scheduler import SampleSet, StaticScheduler
from agglom_mpi.storage.writer import CampaignWriter


class PostStage(ABC):
    """Work on the best strings after the search.

    Attributes
    ----------
    scheduler
        Of its tasks, once it has begun.
    done_before
        What was done before it began, as `StageProgress.done`.
    """

    scheduler: StaticScheduler
    done_before: int

    @property
    @abstractmethod
    def stage(self) -> StageProgress:
        """How much of it is done."""

    @property
    @abstractmethod
    def complete(self) -> bool:
        """Whether nothing is missing in the file, or expected any more."""

    @abstractmethod
    def open(self) -> NDArray[np.void]:
        """Prepare the file; return the tasks, (n,) of `task_type`, for what is missing."""

    @abstractmethod
    def announcement(self, tasks: NDArray[np.void]) -> str:
        """Return a sentence about the work to be done, for the display."""

    def begin(self, ranks: int) -> str:
        """Begin on a number of ranks; return the announcement, empty if there is nothing to do."""
        tasks = self.open()
        self.scheduler = StaticScheduler(tasks, ranks)
        self.done_before = self.stage.done
        return self.announcement(tasks) if len(tasks) else ""


class FrameStage(PostStage):
    """Frames of samples of the best strings, stored in `/frames` in the order of the plan.

    Parameters
    ----------
    plan
        Samples and number of frames of each.
    writer
        Of the campaign file, which may hold frames of an earlier end of the campaign.
    parameters
        Returns the parameter string, (k,), of a number.
    """

    def __init__(
        self,
        plan: FramePlan,
        writer: CampaignWriter,
        parameters: Callable[[int], NDArray[np.float64]],
    ) -> None:
        self._plan = plan
        self._writer = writer
        self._parameters = parameters
        self._places = {pair: place for place, pair in enumerate(plan.samples)}
        self._missing = np.ones(len(plan.samples) * plan.frames, np.bool_)
        stored = writer.frames.keys() if plan.samples else {}
        self._same = all(self._is_wanted(row, key) for row, key in stored.items())
        if self._same:
            self._missing[list(stored)] = False
        self._left = int(np.count_nonzero(self._missing))

    @property
    def complete(self) -> bool:
        """Whether the file holds exactly what is asked for, or nothing is asked for."""
        return self._same and not self._left

    @property
    def stage(self) -> StageProgress:
        """Count the frames that are asked for."""
        total = len(self._missing)
        return StageProgress(total - self._left, total, "pictures")

    def open(self) -> NDArray[np.void]:
        """Drop frames of other samples; return the tasks, (n,), for missing ones."""
        if not self._same:
            self._writer.frames.forget()
            self._same = True
        count = max(1, self._plan.frames)
        lacking = np.unique(np.flatnonzero(self._missing) // count)
        samples = [self._plan.samples[place] for place in lacking.tolist()]
        tasks = new_tasks([self._parameters(string) for string, _ in samples])
        for task, pair in zip(tasks, samples, strict=True):
            task["string"], task["first"] = pair
            task["count"], task["frames"] = 1, count
        return tasks

    def announcement(self, tasks: NDArray[np.void]) -> str:
        """Return a sentence about the work to be done, for the display."""
        return f"taking pictures of {pluralise(len(tasks), 'sample')}, {tasks['frames'][0]} of each"

    def store(self, rows: NDArray[np.void]) -> bool:
        """Write consecutive rows of `/frames` of one sample; return True once it is complete."""
        first = rows[0]
        place = self._places[int(first["string"]), int(first["sample"])]
        count = self._plan.frames
        at = place * count + int(first["frame"])
        self._writer.frames.put(at, rows)
        self._expect_no_more(at, len(rows))
        return not self._missing[place * count :][:count].any()

    def give_up(self, string: int, sample: int) -> None:
        """Expect no more frames of a sample that raised."""
        count = self._plan.frames
        self._expect_no_more(self._places[string, sample] * count, count)

    def _expect_no_more(self, first: int, count: int) -> None:
        rows = self._missing[first : first + count]
        self._left -= int(np.count_nonzero(rows))
        rows[:] = False

    def _is_wanted(self, row: int, key: tuple[int, int, int]) -> bool:
        """Whether a row of `/frames` is to hold this (string, sample, frame)."""
        if row >= len(self._missing):
            return False
        place, frame = divmod(row, self._plan.frames)
        return (*self._plan.samples[place], frame) == key


class ReestimationStage(PostStage):
    """Fresh samples of the best strings, which no decision sees.

    Parameters
    ----------
    plan
        Strings, the best first, and the number of samples of each.
    fresh_from, max_samples
        Numbers of the first fresh sample of a string, and of the first that there is no room for.
    known
        String and number of samples that need no simulation, from an earlier leg, shape (n, 2).
        Those of larger volumes have the numbers of `scheduling.volume_strings`.
    parameters
        Returns the parameter string, (k,), of a number.

    Attributes
    ----------
    size
        Number of strings, and of samples of each in each volume, that are asked for.
    volumes
        Larger control volumes in which they are asked for.
    """

    def __init__(
        self,
        plan: ReestimationPlan,
        fresh_from: int,
        max_samples: int,
        known: NDArray[np.int64],
        parameters: Callable[[int], NDArray[np.float64]],
    ) -> None:
        count = max(0, min(plan.samples, max_samples - fresh_from))
        self.size = len(plan.strings), count
        self.volumes = plan.volumes[1:]
        self._total = len(plan.strings) * len(plan.volumes) * count
        self._parameters = parameters
        wanted = (
            SampleRange(number_in_volume(string, volume), fresh_from, count)
            for string in plan.strings
            for volume in plan.volumes
        )
        self._missing = SampleSet(part for part in wanted if part.size)
        self._missing.discard(known[:, 0], known[:, 1])

    @property
    def complete(self) -> bool:
        """Whether the file holds all that are asked for and that it has room for."""
        return not self._missing

    @property
    def stage(self) -> StageProgress:
        """Count the samples that are asked for."""
        return StageProgress(self._total - len(self._missing), self._total, "fresh samples")

    def open(self) -> NDArray[np.void]:
        """Return the tasks, (n,) of `task_type`, for missing samples, the best string first."""
        lacking = list(self._missing.runs())
        own = [volume_string(part.string).string for part in lacking]
        tasks = new_tasks([self._parameters(string) for string in own])
        for task, part in zip(tasks, lacking, strict=True):
            task["string"], task["first"], task["count"] = part[:3]
        return tasks

    def announcement(self, tasks: NDArray[np.void]) -> str:
        """Return a sentence about the work to be done, for the display."""
        numbers = {volume_string(string).string for string in tasks["string"].tolist()}
        strings = pluralise(len(numbers), "string")
        samples = pluralise(int(tasks["count"].sum()), "fresh sample")
        return f"estimating {strings} again, on {samples}"

    def take(self, rows: NDArray[np.void]) -> None:
        """Take samples, rows of `/samples`, (n,), completed or failed."""
        self._missing.discard(rows["string"], rows["sample"])
