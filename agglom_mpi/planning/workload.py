"""Empirical workload: results and times of samples drawn from recorded or pilot samples.

A simulated string yields its own samples first; all others are drawn from the string nearest to it,
so that a forecast can be as long as the campaign.
"""

from functools import partial
from hashlib import blake2b
from typing import Final, NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from agglom_mpi.analysis.tables import time_on_free_core
from agglom_mpi.config.campaign import Campaign
from agglom_mpi.config.user_function import recorded_function
from agglom_mpi.config.yaml_source import CampaignError, Problem
from agglom_mpi.judge import Judge, samples_needed
from agglom_mpi.outcome import COMPLETED

LEAST_SAMPLES: Final = 5
"""Minimum number of samples of a string that others draw from, if any string has that many. Two
samples that happen to be alike would let every string near it converge at once."""


BLOCK: Final = 16
"""Minimum number of samples of a string that are drawn from a workload at once."""


class PilotSamples(NamedTuple):
    """Simulated samples."""

    rows: NDArray[np.void]
    """Rows of `/samples`, shape (n,), n > 0."""
    parameters: NDArray[np.float64]
    """Their strings in SI units, shape (m, 10); `rows["string"]` is an index into them."""
    differences: tuple[str, ...] = ()
    """Entries of their campaign that differ, as texts."""
    source: str | None = None
    """Campaign file that they were read from; None if they were simulated for the forecast."""


class _Pool(NamedTuple):
    """Rows that a string draws from: its own by sample number, then `size` others from `first`."""

    own: dict[int, int]
    first: int
    size: int
    key: int


class EmpiricalWorkload:
    """A `Workload` drawn from simulated samples.

    A sample takes its processor time: a batch system gives every rank a core of its own.

    Parameters
    ----------
    recorded
        The samples.
    campaign
        Campaign to forecast; distances between strings are measured in its search box.
    """

    def __init__(self, recorded: PilotSamples, campaign: Campaign) -> None:
        lower, upper = campaign.variables.lower, campaign.variables.upper
        self._searched = lower < upper
        self._lower = lower[self._searched]
        self._width = (upper - lower)[self._searched]
        rows = recorded.rows
        rows = rows[np.lexsort((rows["sample"], rows["string"]))]
        self._rows, self._seconds = rows, time_on_free_core(rows)
        self._samples = rows["sample"].tolist()
        counts = np.bincount(rows["string"], minlength=len(recorded.parameters))
        self._first = np.concatenate(([0], np.cumsum(counts)))
        self._rich = np.flatnonzero(counts >= min(LEAST_SAMPLES, counts.max()))
        points = recorded.parameters[:, self._searched]
        self._places = self._in_unit_box(points[self._rich])
        self._strings = {point.tobytes(): string for string, point in enumerate(points)}
        self._pools: dict[bytes, _Pool] = {}

    def samples(
        self, parameters: NDArray[np.float64], first: int, count: int
    ) -> tuple[NDArray[np.void], NDArray[np.float64]]:
        """Return rows of `/samples`, (count,), and times in s, (count,), of samples of a string."""
        name = parameters.tobytes()
        pool = self._pools.get(name)
        if pool is None:
            pool = self._pools[name] = self._pool(parameters[self._searched])
        numbers = np.arange(first, first + count, dtype=np.uint64)
        places = pool.first + (splitmix64(pool.key, numbers) % np.uint64(pool.size)).astype(int)
        if pool.own:
            for place, number in enumerate(range(first, first + count)):
                places[place] = pool.own.get(number, places[place])
        return self._rows[places], self._seconds[places]

    def _in_unit_box(self, points: NDArray[np.float64]) -> NDArray[np.float64]:
        return (points - self._lower) / self._width

    def _pool(self, point: NDArray[np.float64]) -> _Pool:
        same = self._strings.get(point.tobytes())
        own: dict[int, int] = {}
        if same is not None:
            rows = range(self._first[same], self._first[same + 1])
            own = {self._samples[row]: row for row in rows}
        away = self._places - self._in_unit_box(point)
        nearest = self._rich[np.argmin((away**2).sum(axis=1))]
        first, end = self._first[nearest : nearest + 2].tolist()
        digest = blake2b(point.tobytes(), digest_size=8).digest()
        return _Pool(own, first, end - first, int.from_bytes(digest, "little"))


class Workload(Protocol):
    """Results and durations of samples."""

    def samples(
        self, parameters: NDArray[np.float64], first: int, count: int
    ) -> tuple[NDArray[np.void], NDArray[np.float64]]:
        """Return rows with the columns of `OUTCOME`, and times in s, (count,) each.

        Both are always the same for the same string, (k,), and sample.
        """


class DrawnSamples:
    """Samples of a string, drawn from a workload in blocks.

    Attributes
    ----------
    seconds
        Times of the samples drawn so far, s.
    """

    def __init__(self, workload: Workload, parameters: NDArray[np.float64]) -> None:
        self._draw = partial(workload.samples, parameters)
        self._rows: list[NDArray[np.void]] = []
        self.seconds: list[float] = []

    def rows(self, first: int, count: int) -> NDArray[np.void]:
        """Return rows, (count,), of samples from `first` on."""
        self.draw(first + count)
        return self._rows[0][first : first + count]

    def needed(self, first: int, count: int, judge: Judge) -> int:
        """Return how many of `count` samples from `first` on a judge asks for."""
        taken = 0
        while taken < count and not judge.is_decided:
            rows = self.rows(first + taken, min(count - taken, max(BLOCK, taken)))
            completed = rows["state"] == COMPLETED
            numbers = rows["mean_radius_ratio"], rows["particles"]
            taken += samples_needed(judge, completed, *numbers)
        return taken

    def draw(self, count: int) -> None:
        """Draw the first `count` samples, if they are not yet."""
        known = len(self.seconds)
        if count > known:
            rows, seconds = self._draw(known, max(count - known, known, BLOCK))
            self._rows = [np.concatenate([*self._rows, rows])]
            self.seconds.extend(seconds.tolist())


def splitmix64(key: int, counts: NDArray[np.uint64]) -> NDArray[np.uint64]:
    """Return outputs `counts`, (n,), of SplitMix64 seeded with `key` (Steele et al. 2014), (n,)."""
    with np.errstate(over="ignore"):
        z = np.uint64(key) + (counts + np.uint64(1)) * np.uint64(0x9E3779B97F4A7C15)
        z = (z ^ (z >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
        z = (z ^ (z >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
    return z ^ (z >> np.uint64(31))


def read_recorded_samples(path: str, campaign: Campaign) -> PilotSamples:
    """Read the samples of a campaign file, finished or not, with the same searched variables.

    Raises
    ------
    CampaignError
        If other variables were searched, or there is no sample yet.
    NotACampaign, OSError
        If it is not a campaign file, or cannot be read.
    """
    # Imported here because most forecasts need no HDF5.
    from agglom_mpi.storage.reader import read_inversion
    from agglom_mpi.storage.schema import parameters_of

    file = read_inversion(path)
    if (
        campaign.user_function is not None
        and recorded_function(file.identity) != campaign.user_function.without_source
    ):
        message = f"was run with a different objective than {campaign.name}"
        raise CampaignError(Problem(path, None, "objective.call", message))
    boxes = file.variable_rows()
    searched = [str(name.decode()) for name in boxes["name"][boxes["searched"] == 1]]
    if tuple(searched) != campaign.variables.searched:
        wanted = ", ".join(campaign.variables.searched)
        message = f"were searched: {', '.join(searched)}; {campaign.name} searches {wanted}"
        raise CampaignError(Problem(path, None, "variables", message))
    strings, rows = file.string_rows(), file.all_sample_rows()
    known = np.isin(rows["string"], strings["string"])  # a damaged string is absent
    rows = rows[known]
    if not len(rows):
        raise CampaignError(Problem(path, None, "", "has no samples yet"))
    rows["string"] = np.searchsorted(strings["string"], rows["string"])
    table = campaign.variables
    parameters = table.of_other(parameters_of(strings), file.variables)
    then, now = file.identity, campaign.identity()
    differences = tuple(
        f"{key} was {then.get(key, 'absent')}, is {now.get(key, 'absent')}"
        for key in {**now, **then}
        if key.split(".")[0] in ("scene", "variables") and then.get(key) != now.get(key)
    )
    return PilotSamples(rows, parameters, differences, path)
