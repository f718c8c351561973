"""From tasks to results on one rank: simulation of samples, timeouts and exceptions."""

import time
import traceback
from abc import ABC, abstractmethod
from collections.abc import Callable
from typing import Final

import numpy as np
from numpy.typing import NDArray

from agglom_mpi.config.simulate import evaluate_function, random_numbers
from agglom_mpi.outcome import COMPLETED, FAILED, OUTCOME, FailureReason, final_particles
from agglom_mpi.runtime.experiment import Experiment, SampleSetup
from agglom_mpi.runtime.messages import (
    FAILED_SAMPLE,
    NOT_NEEDED,
    RankMessage,
    failed_sample,
)
from agglom_mpi.simulation.compilation import compile_kernels
from agglom_mpi.simulation.frames import frame_times, new_frames
from agglom_mpi.simulation.sample import simulate_scene
from agglom_mpi.simulation.scene import Scene
from agglom_mpi.stopwatch import Stopwatch, TimeSpent
from agglom_mpi.storage.particle_tables import final_row, frame_rows
from agglom_mpi.storage.schema import TOOK_TOO_LONG, samples_schema
from agglom_mpi.storage.table import concatenated

_NO_TIME: Final = TimeSpent(0.0, 0.0)


class SampleRunner:
    """Run tasks; the same on every rank, with the results of `campaign.simulate`.

    Parameters
    ----------
    experiment
        What the strings are, and how their samples are simulated.
    rank
        Number of this rank.

    Attributes
    ----------
    abort_flag
        Ends samples early.
    grains
        Largest number of particles of a sample whose particles are stored.
    quantities
        SI units of the quantities that the objective's function returns, by name.
    result_dtype
        Type of the results of samples, rows of `/samples`.
    """

    def __init__(self, experiment: Experiment, rank: int) -> None:
        self.abort_flag = AbortFlag(experiment.max_seconds)
        self.experiment = experiment
        self.rank = rank
        self.stores_particles = experiment.table_sizes.final_particles
        self.grains = experiment.table_sizes.grains
        self.quantities = dict(experiment.table_sizes.quantities)
        self.result_dtype = samples_schema(self.quantities).dtype
        self._scene: tuple[tuple[int, bytes], Scene] | None = None

    def warm_up(self, show: Callable[[str], None] = lambda line: None) -> None:
        """Compile, or load from the cache, every kernel that samples of this experiment need.

        `show` is called with lines on what is being compiled.
        """
        for setup, parameters in self.experiment.kernel_cases():
            scene = scene_of(setup, parameters)
            compile_kernels(scene, bool(self.experiment.table_sizes.frames), show)

    def begin(self, task: np.void) -> "Task":
        """Return the task of a record of `task_type`, with no sample simulated yet."""
        return FrameTask(self, task) if task["frames"] else SampleTask(self, task)

    def scene_of(self, string: int, setup: SampleSetup, parameters: NDArray[np.float64]) -> Scene:
        """Return the scene of a string; that of the last one is kept."""
        key = string, parameters.tobytes()
        if self._scene is None or self._scene[0] != key:
            self._scene = key, scene_of(setup, parameters)
        return self._scene[1]


def scene_of(setup: SampleSetup, parameters: NDArray[np.float64]) -> Scene:
    """Return the scene of one parameter string, shape (k,), in a set-up."""
    return setup.campaign.at(parameters).build(setup.engine)


class AbortFlag:
    """Ends samples early, from another thread than the one that simulates.

    All of them on `stop`, one that takes too long on `check_time`, any one on `interrupt`.

    Parameters
    ----------
    max_seconds
        Longest time of a sample in s; None without a limit.

    Attributes
    ----------
    abort
        Read by kernels, shape (1,); anything but 0 ends them.
    stopped
        Whether no more samples are wanted.
    """

    def __init__(self, max_seconds: float | None) -> None:
        self.abort = np.zeros(1, np.uint8)
        self.stopped = False
        self.max_seconds = max_seconds
        self._begun: float | None = None

    def stop(self) -> None:
        """End all samples, from now on."""
        self.stopped = True
        self.abort[0] = 1

    def check_time(self) -> None:
        """End the sample under way if it has taken too long."""
        if self._late:
            self.abort[0] = 1

    def interrupt(self) -> None:
        """End the sample under way, if there is one; it may be simulated again."""
        self.abort[0] = 1

    def begin(self) -> None:
        """Start the clock of a sample."""
        if self.max_seconds is not None:
            self._begun = time.monotonic()

    def end(self) -> tuple[bool, bool]:
        """Stop the clock; return if the sample took too long, and if it may be cut off."""
        late, self._begun = self._late, None
        interrupted = bool(self.abort[0])
        if interrupted and not self.stopped:
            self.abort[0] = 0
            if self.stopped:  # just now
                self.abort[0] = 1
        return late, interrupted

    @property
    def _late(self) -> bool:
        begun, most = self._begun, self.max_seconds
        return begun is not None and most is not None and time.monotonic() - begun > most


class Task(ABC):
    """Consecutive samples of one string, simulated one by one.

    Parameters
    ----------
    runner
        Of this rank.
    task
        A record of `scheduling.interface.task_type`.
    """

    def __init__(self, runner: SampleRunner, task: np.void) -> None:
        self._runner = runner
        self._abort_flag = runner.abort_flag
        self._string, self._first, self._count = (
            int(task[name]) for name in ("string", "first", "count")
        )
        self._frames = int(task["frames"])
        self._parameters = np.array(task["parameters"])
        self._done = 0
        self._wasted = _NO_TIME  # of a sample that was interrupted
        self._failures: list[NDArray[np.void]] = []

    def simulate_next(self) -> bool:
        """Simulate the next sample; return whether there is another one to simulate.

        One that is ended by `AbortFlag.stop` leaves nothing. One that is ended by an interrupt, or
        by a check of the time that was meant for the sample before, is simulated again. Times are
        those of the thread that calls this.
        """
        stopwatch, text, reason = Stopwatch(), "", 0
        self._abort_flag.begin()
        try:
            self._simulate(self._first + self._done)
        except Exception:
            text, reason = traceback.format_exc(), FailureReason.EXCEPTION
        late, interrupted = self._abort_flag.end()
        if self._abort_flag.stopped:
            return False
        if late:
            text = f"{TOOK_TOO_LONG} {self._abort_flag.max_seconds:g} s"
            reason = FailureReason.TIMED_OUT
        elif interrupted:
            self._wasted = stopwatch.read()
            return True
        if reason:
            sample, rank = self._first + self._done, self._runner.rank
            self._failures.append(failed_sample(self._string, sample, rank, text, self._frames))
        self._keep(reason, stopwatch.read())
        self._done += 1
        return self._done < self._count

    def cancel(self) -> None:
        """Leave out the samples that are not simulated yet: they are not needed any more."""
        while self._done < self._count:
            self._keep(NOT_NEEDED, self._wasted)
            self._wasted = _NO_TIME
            self._done += 1

    def collect(self) -> RankMessage:
        """Return what was finished since the last call."""
        failures, self._failures = self._failures, []
        return self._finished()._replace(failures=concatenated(failures, FAILED_SAMPLE))

    @abstractmethod
    def _simulate(self, sample: int) -> None:
        """Simulate a sample."""

    @abstractmethod
    def _keep(self, reason: int, spent: TimeSpent) -> None:
        """Keep what `_simulate` has made in that time, unless there is a reason for its failure."""

    @abstractmethod
    def _finished(self) -> RankMessage:
        """Return what was kept since the last call."""

    def _start(self, sample: int) -> tuple[SampleSetup, Scene, np.random.Generator]:
        setup = self._runner.experiment.setup(self._string)
        scene = self._runner.scene_of(self._string, setup, self._parameters)
        number = setup.first_sample + sample
        return setup, scene, random_numbers(setup.campaign, self._parameters, number)


class SampleTask(Task):
    """Samples whose results are recorded."""

    def __init__(self, runner: SampleRunner, task: np.void) -> None:
        super().__init__(runner, task)
        self._collected = 0
        self._rows = np.zeros(self._count, runner.result_dtype)
        self._records = self._rows[list(OUTCOME.names or ())]  # a view
        self._rows["string"], self._rows["rank"] = self._string, runner.rank
        self._rows["sample"] = np.arange(self._first, self._first + self._count)
        self._times = self._rows[["seconds", "cpu_seconds", "finished"]]  # a view
        self._final: NDArray[np.void] | None = None
        self._finals: list[NDArray[np.void]] = []

    def _finished(self) -> RankMessage:
        rows = self._rows[self._collected : self._done]
        self._collected = self._done
        completed = rows["state"] == COMPLETED
        if completed.any():
            campaign = self._runner.experiment.setup(self._string).campaign
            objective = campaign.objective_at(self._parameters)
            rows["objective"][completed] = objective.of_samples(rows)[completed]
        finals, self._finals = self._finals, []
        final = concatenated(finals, finals[0].dtype) if finals else None
        return RankMessage(self._runner.rank, rows, final_particles=final)

    def _simulate(self, sample: int) -> None:
        self._final = None
        setup, scene, random = self._start(sample)
        record, code = self._records[self._done], setup.campaign.user_function
        self._records[self._done], particles = simulate_scene(scene, random, self._abort_flag.abort)
        stores = self._runner.stores_particles
        if record["state"] != COMPLETED or not (stores or code):
            return
        final = final_particles(scene, particles)
        if stores:
            self._final = final_row(self._string, sample, final, scene.particles)
        if code and not self._abort_flag.abort[0]:  # one that was cut short is not finished
            number, done = setup.first_sample + sample, (scene, record, final)
            found = evaluate_function(setup.campaign, self._parameters, number, done)
            for name, value in {"objective": found.objective, **found.quantities}.items():
                self._rows[name][self._done] = value

    def _keep(self, reason: int, spent: TimeSpent) -> None:
        at = self._done
        if reason:
            self._records[at] = np.zeros((), OUTCOME)
            self._records[at]["state"], self._records[at]["reason"] = FAILED, reason
            for name in ("objective", *self._runner.quantities):
                self._rows[name][at] = 0.0
        elif self._final is not None:
            self._finals.append(self._final)
        self._times[at] = *spent, time.time()


class FrameTask(Task):
    """Samples that are simulated once more to store their frames."""

    def __init__(self, runner: SampleRunner, task: np.void) -> None:
        super().__init__(runner, task)
        self._sample_rows: NDArray[np.void] | None = None
        self._kept: list[NDArray[np.void]] = []

    def _finished(self) -> RankMessage:
        frames, self._kept = tuple(self._kept), []
        return RankMessage(self._runner.rank, frames=frames)

    def _simulate(self, sample: int) -> None:
        self._sample_rows = None
        _, scene, random = self._start(sample)
        frames = new_frames(frame_times(self._frames, scene.end_time), scene.particles)
        # A sample that fails has no particles in the frames after that.
        simulate_scene(scene, random, self._abort_flag.abort, frames)
        self._sample_rows = frame_rows(self._string, sample, frames)

    def _keep(self, reason: int, spent: TimeSpent) -> None:
        if not reason and self._sample_rows is not None:
            self._kept.append(self._sample_rows)
