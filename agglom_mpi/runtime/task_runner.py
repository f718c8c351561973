"""From tasks to results on one rank: simulation of samples, timeouts and exceptions."""

import math
import time
import traceback
from abc import ABC, abstractmethod
from collections.abc import Callable
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from agglom_mpi.config.own_components import permitted_modules
from agglom_mpi.judge import decides, new_judge
from agglom_mpi.measurements.layout import CensusLayout
from agglom_mpi.outcome import COMPLETED, FAILED, FailureReason, final_particles, outcome_type
from agglom_mpi.runtime.abort_flag import AbortFlag
from agglom_mpi.runtime.experiment import Experiment
from agglom_mpi.runtime.messages import FAILED_SAMPLE, PART, RankMessage, failed_sample
from agglom_mpi.runtime.own_code_notes import OwnCodeNotes
from agglom_mpi.runtime.simulated_strings import SimulatedString, SimulatedStrings, scene_of
from agglom_mpi.scheduling.interface import MOST_SAMPLES
from agglom_mpi.simulation.census import CensusRoom, census_values, new_census_room
from agglom_mpi.simulation.compilation import compile_kernels
from agglom_mpi.simulation.frames import frame_times, new_frames
from agglom_mpi.simulation.sample import simulate_counted, simulate_samples, simulate_scene
from agglom_mpi.simulation.sample_draws import samples_at_once
from agglom_mpi.simulation.sample_range import TIMES, SampleResults, new_results
from agglom_mpi.stopwatch import Stopwatch, TimeSpent
from agglom_mpi.storage.particle_tables import final_row, frame_rows
from agglom_mpi.storage.schema import SAMPLES, TOOK_TOO_LONG, samples_schema
from agglom_mpi.storage.table import checksums, concatenated
from agglom_mpi.verbs.simulate import objective_value, random_numbers, simulate_experiments

MAX_AT_ONCE: Final = MOST_SAMPLES
"""Maximum number of samples of one call of compiled code, those of a message; with 1 each is
simulated by `simulate_scene`."""

MOST_DRAWN: Final = 16
"""Maximum number of samples whose grains' sizes are drawn ahead where not all may be needed."""

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
    sizes
        Sizes of the tables that rows are for.
    strings
        The strings that tasks are of.
    outcome
        Type of the results of the kernels, as far as rows have them.
    census
        Layout of the censuses of samples of one scene; None: none are taken.
    further_columns
        Columns of a row beside those that every campaign has.
    notes
        Notes of samples that run code of the user's; None where there is none.
    result_dtype
        Type of the results of samples, rows of `/samples`.
    """

    def __init__(self, experiment: Experiment, rank: int) -> None:
        self.abort_flag = AbortFlag(experiment.max_seconds)
        self.experiment = experiment
        self.rank = rank
        self.sizes = experiment.table_sizes
        self.strings = SimulatedStrings(experiment)
        self.outcome = outcome_type(self.sizes.spins)
        layouts = self.sizes.census
        self.census = layouts if isinstance(layouts, CensusLayout) else None
        schema = samples_schema(self.sizes.quantities, layouts)
        self.result_dtype = schema.dtype
        self.further_columns = [c.name for c in schema.fields if c not in SAMPLES.fields]
        self.notes: OwnCodeNotes | None = None
        if experiment.noted_beside is not None and permitted_modules(experiment.campaign):
            self.notes = OwnCodeNotes(experiment.noted_beside, rank)

    def warm_up(self, show: Callable[[str], None] = lambda line: None) -> None:
        """Compile, or load from the cache, every kernel that samples of this experiment need.

        `show` is called with lines on what is being compiled.
        """
        for setup, parameters in self.experiment.kernel_cases():
            scene, counts = scene_of(setup, parameters), self.sizes.census is not None
            compile_kernels(scene, bool(self.sizes.frames), show, counts)

    def begin(self, task: np.void) -> "Task":
        """Return the task of a record of `task_type`, with no sample simulated yet."""
        if task["frames"]:
            return FrameTask(self, task)
        kind = ExperimentsTask if self.experiment.campaign.experiments else SampleTask
        return kind(self, task)

    def in_row(self, records: Any) -> Any:
        """Return what rows have of results: those of a study of several scenes none of spins."""
        names = self.outcome.names or ()
        return records if records.dtype.names == names else records[list(names)]


class Task(ABC):
    """Consecutive samples of one string, simulated in order.

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
        self._task = task.copy()
        self._parameters = np.array(task["parameters"])
        self._done = 0
        self._leaves_out = False
        self._wasted = _NO_TIME  # of a sample that was interrupted
        self._stopwatch = Stopwatch()  # of a call of `simulate_next`
        self._accounted = _NO_TIME  # of it, by the samples that are kept
        self._failures: list[NDArray[np.void]] = []

    def simulate_next(self, seconds: float = math.inf) -> bool:
        """Simulate samples, at least one; return whether there is another one to simulate.

        One that is ended by `AbortFlag.stop` leaves nothing. One that is ended by an interrupt, or
        by a check of the time that was meant for the sample before, is simulated again. Times are
        those of the thread that calls this.

        Parameters
        ----------
        seconds
            Time after which no further sample is begun, in s.
        """
        text, reason, sample = "", 0, self._first + self._done
        self._stopwatch, self._accounted = Stopwatch(), _NO_TIME
        self._abort_flag.begin(self._string, sample)
        try:
            is_open = self._simulate(sample, seconds)
        except Exception:
            text, reason, is_open = traceback.format_exc(), FailureReason.EXCEPTION, True
        late, interrupted = self._abort_flag.end()
        if self._abort_flag.stopped:
            return False
        if not is_open:
            return self._goes_on()
        spent = self._stopwatch.read().less(self._accounted)
        if late:
            text = f"{TOOK_TOO_LONG} {self._abort_flag.max_seconds:g} s"
            reason = FailureReason.TIMED_OUT
        elif interrupted:
            self._wasted = spent
            return True
        if reason:
            sample, rank = self._first + self._done, self._runner.rank
            self._failures.append(failed_sample(self._string, sample, rank, text, self._frames))
        self._keep(reason, spent)
        self._done += 1
        return self._goes_on()

    def cancel(self) -> None:
        """Leave out the samples that are not simulated yet: they are not needed any more."""
        self._leaves_out |= self._done < self._count
        self._count = self._done

    def collect(self) -> RankMessage:
        """Return what was finished since the last call."""
        failures, self._failures = self._failures, []
        return self._finished()._replace(failures=concatenated(failures, FAILED_SAMPLE))

    @abstractmethod
    def _simulate(self, sample: int, seconds: float) -> bool:
        """Simulate a sample, or several from it on; return whether the last one is still open.

        What that is worth is decided when its time has been checked. Those before it are kept.
        """

    @abstractmethod
    def _keep(self, reason: int, spent: TimeSpent) -> None:
        """Keep what `_simulate` has made in that time, unless there is a reason for its failure."""

    @abstractmethod
    def _finished(self) -> RankMessage:
        """Return what was kept since the last call."""

    def _goes_on(self) -> bool:
        """Return whether there is another sample to simulate."""
        return self._done < self._count

    def _simulated(self) -> SimulatedString:
        return self._runner.strings.of(self._string, self._parameters)


class SampleTask(Task):
    """Samples whose results are recorded.

    All are simulated by one call of compiled code, as far as it gets in the time, unless something
    in Python follows each. A task that is judged ends with the last sample that its string needs.
    """

    def __init__(self, runner: SampleRunner, task: np.void) -> None:
        super().__init__(runner, task)
        self._collected = 0
        self._rows = np.zeros(self._count, runner.result_dtype)
        self._records = self._rows[list(runner.outcome.names or ())]  # a view
        self._rows["string"], self._rows["rank"] = self._string, runner.rank
        self._rows["sample"] = np.arange(self._first, self._first + self._count)
        self._times = self._rows[list(TIMES.names or ())]  # a view
        self._final: NDArray[np.void] | None = None
        self._finals: list[NDArray[np.void]] = []
        self._judge = new_judge()

    def _goes_on(self) -> bool:
        if self._judge.is_decided:
            self.cancel()
        return super()._goes_on()

    def _finished(self) -> RankMessage:
        rows, first = self._rows[self._collected : self._done], self._first + self._collected
        self._collected = self._done
        completed = rows["state"] == COMPLETED
        if completed.any():
            objective = self._simulated().objective
            rows["objective"][completed] = objective.of_samples(rows)[completed]
        rows["crc"] = checksums(rows)
        finals, self._finals = self._finals, []
        leaves_out, self._leaves_out = self._leaves_out, False
        parts = np.zeros(int(leaves_out or len(rows) > 0), PART)
        wasted = self._wasted if leaves_out else _NO_TIME
        parts[:] = self._string, first, len(rows), leaves_out, *wasted
        final = concatenated(finals, finals[0].dtype) if finals else None
        return RankMessage(self._runner.rank, rows, parts, final_particles=final)

    def _simulate(self, sample: int, seconds: float) -> bool:
        string = self._simulated()
        setup, scene = string.setup, string.scene
        if not self._done and (judge := string.judge(self._task)) is not None:
            self._judge = judge
        # Those of a larger volume have more particles than a row has room for.
        stores = self._runner.sizes.final_particles and setup.campaign.volume == 1
        code = setup.campaign.user_function
        alone = MAX_AT_ONCE == 1 or stores or code is not None
        if self._runner.notes is not None:
            self._runner.notes.begin(self._string, sample, 1 if alone else self._count - self._done)
        if not alone:
            return self._simulate_range(sample, seconds)
        self._final = None
        number, record = setup.first_sample + sample, self._records[self._done]
        random = random_numbers(setup.campaign, self._parameters, number)
        layout, abort = self._runner.census, self._abort_flag.abort
        if layout is None:
            census = None
            result, particles = simulate_scene(scene, random, abort)
        else:
            census = new_census_room(layout, 1)
            result, particles = simulate_counted(scene, random, census, abort)
        self._records[self._done] = self._runner.in_row(result)
        self._keep_censuses(slice(self._done, self._done + 1), census)
        if record["state"] != COMPLETED or not (stores or code):
            return True
        final = final_particles(scene, particles)
        if stores:
            self._final = final_row(self._string, sample, final, scene.particles)
        if code and not self._abort_flag.abort[0]:  # one that was cut short is not finished
            done, parameters = (scene, record, final), self._parameters
            for name, value in objective_value(setup.campaign, parameters, number, done).items():
                self._rows[name][self._done] = value
        return True

    def _simulate_range(self, sample: int, seconds: float) -> bool:
        """Simulate samples by one call of compiled code, as `_simulate`."""
        setup, scene, words, *_ = self._simulated()
        count = min(self._count - self._done, MAX_AT_ONCE, samples_at_once(scene))
        if self._judge.state["asked"][0] and scene.sizes is not None:
            count = min(count, MOST_DRAWN)
        results = new_results(count, self._runner.census, scene.has_spins)
        watch = self._abort_flag.watch(seconds)._replace(judge=self._judge)
        self._abort_flag.follow(results.finished)
        try:
            is_cut = simulate_samples(scene, words, setup.first_sample + sample, watch, results)
        finally:
            self._keep_finished(results)
        if is_cut:
            self._abort_flag.interrupt()  # whatever has cut it off, it has no result
        return is_cut

    def _keep_finished(self, results: SampleResults) -> None:
        """Keep the results of the samples that are finished."""
        count = int(results.finished[0])
        times = results.times[:count]
        here = slice(self._done, self._done + count)
        self._records[here] = self._runner.in_row(results.records[:count])
        self._times[here] = times
        self._keep_censuses(here, results.census)
        self._accounted = TimeSpent(times["seconds"].sum(), times["cpu_seconds"].sum())
        self._done += count

    def _keep_censuses(self, here: slice, census: CensusRoom | None) -> None:
        """Keep the censuses of samples that did not fail."""
        if census is None:
            return
        rows = self._rows[here]
        completed = rows["state"] == COMPLETED
        for name, values in census_values(census).items():
            rows[name][completed] = values[: len(rows)][completed]

    def _keep(self, reason: int, spent: TimeSpent) -> None:
        at = self._done
        if reason:
            self._records[at] = np.zeros((), self._runner.outcome)
            self._records[at]["state"], self._records[at]["reason"] = FAILED, reason
            self._judge.state["asked"] = False
            for name in ("objective", *self._runner.further_columns):
                self._rows[name][at] = 0
        else:
            row = self._records[at]
            numbers = row["mean_radius_ratio"], row["particles"]
            decides(self._judge, row["state"] == COMPLETED, *numbers)
            if self._final is not None:
                self._finals.append(self._final)
        self._times[at] = *spent, time.time()


class ExperimentsTask(SampleTask):
    """Samples of all experiments of a campaign, each sample of one after the other."""

    def _simulate(self, sample: int, seconds: float) -> bool:
        string, row = self._simulated(), self._rows[self._done]
        number = string.setup.first_sample + sample
        simulate_experiments(string.experiments, number, row, self._abort_flag.abort)
        return True


class FrameTask(Task):
    """Samples that are simulated once more to store their frames."""

    def __init__(self, runner: SampleRunner, task: np.void) -> None:
        super().__init__(runner, task)
        self._sample_rows: NDArray[np.void] | None = None
        self._kept: list[NDArray[np.void]] = []

    def _finished(self) -> RankMessage:
        frames, self._kept = tuple(self._kept), []
        return RankMessage(self._runner.rank, frames=frames)

    def _simulate(self, sample: int, seconds: float) -> bool:
        self._sample_rows = None
        setup, scene, *_ = self._simulated()
        number = setup.first_sample + sample
        random = random_numbers(setup.campaign, self._parameters, number)
        frames = new_frames(
            frame_times(self._frames, scene.end_time), scene.particles, self._runner.sizes.spins
        )
        # A sample that fails has no particles in the frames after that.
        simulate_scene(scene, random, self._abort_flag.abort, frames)
        self._sample_rows = frame_rows(self._string, sample, frames)
        return True

    def _keep(self, reason: int, spent: TimeSpent) -> None:
        if not reason and self._sample_rows is not None:
            self._kept.append(self._sample_rows)
