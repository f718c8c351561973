"""Samples of many strings at once, on all cores: what a sampler of one's own calls.

Threads of this process share the strings. Kernels release the lock of the interpreter, and a thread
simulates consecutive samples of a string by one call of compiled code.
"""

import os
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from dataclasses import dataclass
from typing import Any, Final, NamedTuple

import numpy as np
import numpy.typing as npt

from agglom_mpi.config.campaign import Campaign
from agglom_mpi.config.given_strings import Parameters, read_strings
from agglom_mpi.declaration.spelling import suggestion
from agglom_mpi.errors import UserError, named_error
from agglom_mpi.formatting import pluralise
from agglom_mpi.outcome import COLUMNS, COMPLETED, FAILED, OUTCOME, REASONS, final_particles
from agglom_mpi.public_face import PublicFace
from agglom_mpi.random_streams import key_words
from agglom_mpi.simulation.compilation import ensure_compiled
from agglom_mpi.simulation.engines import Engine
from agglom_mpi.simulation.sample import simulate_samples, simulate_scene
from agglom_mpi.simulation.sample_draws import samples_at_once
from agglom_mpi.simulation.sample_range import new_results, new_watch
from agglom_mpi.simulation.scene import Scene
from agglom_mpi.verbs.simulate import objective_value, random_numbers, stream_key

Floats = npt.NDArray[np.float64]

THREADS_PER_CORE: Final = 4
"""Maximum number of threads per core; more are of no use, and the system may refuse thousands."""
PARTS_PER_WORKER: Final = 8
"""Number of parts of the work per thread, so that all threads end at about the same time."""

_STATE: Final = ("state", "reason")
"""Columns of a sample that `failed` and `reasons` replace."""


@dataclass(frozen=True, eq=False, repr=False)
class SimulatedSamples(metaclass=PublicFace):
    """Samples of m strings, which `campaign.simulate_many` returns.

    Each column is an array of shape (m, samples), as an attribute or by its name:
    `found.mean_radius_ratio` is `found["mean_radius_ratio"]`. Where a sample failed, columns of
    real numbers are nan, and counts are 0.

    Attributes
    ----------
    columns : dict
        All columns by name: results of the samples, the campaign's `objective` of each sample
        alone, quantities that the objective's function returned, and `seconds`.
    units : dict
        SI unit of each column.
    failed : array of bool, shape (m, samples)
        Whether a sample failed.
    reasons : dict
        Reasons of the samples that failed, by their places (string, sample) in the arrays.
    parameters : array, shape (m, k)
        The strings in SI units.
    """

    columns: dict[str, npt.NDArray[Any]]
    units: dict[str, str]
    failed: npt.NDArray[np.bool_]
    reasons: dict[tuple[int, int], str]
    parameters: Floats

    def __getattr__(self, name: str) -> npt.NDArray[Any]:
        columns = {} if name.startswith("_") else self.__dict__.get("columns", {})
        if name in columns:
            found: npt.NDArray[Any] = columns[name]
            return found
        near = f"; {suggestion(name, columns)}" if columns else ""
        raise AttributeError(f"{type(self).__name__!r} object has no column {name!r}{near}")

    def __getitem__(self, name: str) -> npt.NDArray[Any]:
        if name not in self.columns:
            raise KeyError(f"{name!r} is no column; {suggestion(name, self.columns)}")
        return self.columns[name]

    def __dir__(self) -> list[str]:
        return sorted({*vars(self), *self.columns})

    def __repr__(self) -> str:
        strings, samples = self.failed.shape
        text = (
            f"{pluralise(strings, 'string')}, {pluralise(samples, 'sample')} of each, "
            f"{int(self.failed.sum())} failed"
        )
        if not self.failed.all():
            means = {n: self.columns[n][~self.failed] for n in ("mean_radius_ratio", "objective")}
            text += "".join(f"; {name} {each.mean():.4g}" for name, each in means.items())
            text += " on average"
        return f"<SimulatedSamples: {text}>"


class _Work(NamedTuple):
    """Work that the threads share.

    `strings`, (m, k), are in SI units. `rows`, (m, samples), have the columns of `OUTCOME`.
    Anything but 0 in `abort`, (1,), ends all samples.
    """

    campaign: Campaign
    strings: Floats
    first: int
    engine: Any
    rows: npt.NDArray[Any]
    reasons: dict[tuple[int, int], str]
    abort: npt.NDArray[np.uint8]


def simulate_many(
    campaign: Campaign,
    parameters: Parameters,
    samples: int = 1,
    workers: int | None = None,
    engine: str | Engine | None = None,
    first_sample: int = 0,
) -> SimulatedSamples:
    """Simulate samples of many strings by threads; see `RunnableCampaign.simulate_many`."""
    campaign.require_one_scene("simulate_many")
    first = campaign.count("first_sample", first_sample)
    count = campaign.count("samples", samples, least=1)
    if workers is not None:
        workers = campaign.count("workers", workers, least=1)
    strings = read_strings(campaign, parameters)
    quantities = campaign.sample_quantities
    added = [(name, "f8") for name in ("objective", "seconds", "cpu_seconds", *quantities)]
    rows = np.zeros((len(strings), count), [*OUTCOME.descr, *added])
    abort = np.zeros(1, np.uint8)
    work = _Work(campaign, strings, first, campaign.engine(engine), rows, {}, abort)
    if rows.size:
        cores = len(os.sched_getaffinity(0))
        _run(work, min(workers or cores, THREADS_PER_CORE * cores))
    failed = rows["state"] != COMPLETED
    columns = {
        name: np.where(failed, np.nan, rows[name]) if rows[name].dtype.kind == "f" else rows[name]
        for name in rows.dtype.names or ()
        if name not in _STATE
    }
    units = {column.name: column.unit for column in COLUMNS if column.name in columns}
    units |= {"objective": "1", "seconds": "s", "cpu_seconds": "s"} | quantities
    places = list(zip(*np.nonzero(failed), strict=True))
    reasons = {
        (int(i), int(j)): work.reasons.get((i, j)) or REASONS[rows["reason"][i, j]]
        for i, j in places
    }
    return SimulatedSamples(columns, units, failed, reasons, strings)


def _run(work: _Work, workers: int) -> None:
    """Simulate everything by a number of threads.

    The calling thread waits, so that a Ctrl-C reaches it at once and ends the samples under way.
    """
    campaign = work.campaign
    with suppress(ValueError):  # a law may refuse the middle of the box, and no other string
        ensure_compiled(campaign.at(campaign.variables.at(0.5)).build(work.engine))
    total = work.rows.size
    size = -(-total // (workers * PARTS_PER_WORKER))
    pool = ThreadPoolExecutor(min(workers, total), "samples")
    try:
        parts = [(begin, min(begin + size, total)) for begin in range(0, total, size)]
        for future in [pool.submit(_simulate_part, work, *part) for part in parts]:
            future.result()
    finally:
        work.abort[0] = 1
        pool.shutdown(cancel_futures=True)


def _simulate_part(work: _Work, begin: int, end: int) -> None:
    """Simulate the samples in places `begin` to `end - 1` of all, string by string."""
    for i, places in _by_string(begin, end, work.rows.shape[1]):
        try:
            work.campaign.check_scales(work.strings[i])
            scene = work.campaign.at(work.strings[i]).build(work.engine)
        except (UserError, ValueError) as error:
            for j in places:
                _fail(work, i, j, str(error))
            continue
        _simulate_string(work, i, scene, places)


def _by_string(begin: int, end: int, samples: int) -> Iterator[tuple[int, range]]:
    """Yield strings with the places of their samples that lie in a part."""
    for i in range(begin // samples, (end - 1) // samples + 1):
        first = i * samples
        yield i, range(max(begin - first, 0), min(end - first, samples))


def _simulate_string(work: _Work, i: int, scene: Scene, places: range) -> None:
    """Simulate samples of a string; an exception is the failure of the sample that raised it."""
    done, needs_python = places.start, work.campaign.objective.code is not None
    words = key_words(stream_key(work.campaign, work.strings[i]))
    while done < places.stop and not work.abort[0]:
        count = 1 if needs_python else min(places.stop - done, samples_at_once(scene))
        try:
            if needs_python:
                _simulate_with_function(work, i, done, scene)
            else:
                count = _simulate_range(work, i, range(done, done + count), scene, words)
        except Exception as error:  # laws and functions of the user's may raise any
            _fail(work, i, done, named_error(error))
            count = 1
        done += count


def _simulate_range(
    work: _Work, i: int, places: range, scene: Scene, words: npt.NDArray[np.uint64]
) -> int:
    """Simulate samples by one call of compiled code; return how many are finished."""
    results = new_results(len(places), spins=scene.has_spins)
    simulate_samples(scene, words, work.first + places.start, new_watch(work.abort), results)
    count = int(results.finished[0])
    rows = work.rows[i, places.start : places.start + count]
    for name in results.records.dtype.names or ():
        rows[name] = results.records[name][:count]
    for name in ("seconds", "cpu_seconds"):
        rows[name] = results.times[name][:count]
    rows["objective"] = work.campaign.objective_at(work.strings[i]).of_samples(rows)
    return count


def _simulate_with_function(work: _Work, i: int, j: int, scene: Scene) -> None:
    string, number = work.strings[i], work.first + j
    random = random_numbers(work.campaign, string, number)
    record, particles = simulate_scene(scene, random, work.abort)
    if work.abort[0]:
        return
    row = work.rows[i, j]
    for name in record.dtype.names:
        row[name] = record[name]
    if record["state"] == COMPLETED:
        final = final_particles(scene, particles)
        done = (scene, record, final)
        for name, value in objective_value(work.campaign, string, number, done).items():
            row[name] = value


def _fail(work: _Work, i: int, j: int, reason: str) -> None:
    work.rows["state"][i, j] = FAILED
    work.reasons[i, j] = reason
