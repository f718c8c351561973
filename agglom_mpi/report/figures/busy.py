"""How busy the ranks were over time, from when each sample ended and how long it took."""

from collections.abc import Iterator
from typing import TYPE_CHECKING, Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from agglom_mpi.report.figures.axes import grid, legend_below, say
from agglom_mpi.report.picture import COLOURS, Picture
from agglom_mpi.storage.reader import CampaignData

if TYPE_CHECKING:
    import matplotlib.figure

Floats = NDArray[np.float64]

BINS: Final = 120


class Leg(NamedTuple):
    """One start of the program: Unix times of its start and end in s, and its ranks."""

    started: float
    stopped: float
    ranks: int


class Load(NamedTuple):
    """How busy the ranks were in B intervals of wall-clock time, gaps between legs left out.

    Attributes
    ----------
    edges
        Shape (B + 1,), s.
    mean, least, most
        Share of the time that ranks simulated: of all, of the idlest, of the busiest, (B,).
    seams
        Where one leg ended and the next began, s.
    share
        Over the whole time.
    """

    edges: Floats
    mean: Floats
    least: Floats
    most: Floats
    seams: list[float]
    share: float


def legs_of(rows: np.ndarray, finished: Floats) -> list[Leg]:
    """Return the legs in rows of `/legs`; one without an end lasts until its last sample."""
    legs = []
    for place, row in enumerate(rows):
        end = float(row["stopped"])
        if not np.isfinite(end):
            after = float(rows["started"][place + 1]) if place + 1 < len(rows) else np.inf
            own = finished[(finished >= row["started"]) & (finished < after)]
            end = float(own.max()) if len(own) else float(row["started"])
        if end > row["started"]:
            legs.append(Leg(float(row["started"]), end, int(row["ranks"])))
    return legs


def load(legs: list[Leg], finished: Floats, seconds: Floats, rank: NDArray[np.int64]) -> Load:
    """Return how busy the ranks were.

    Parameters
    ----------
    finished, seconds, rank
        When each of n samples ended (Unix time, s), how long it took (s) and who simulated it.
    """
    width = sum(leg.stopped - leg.started for leg in legs) / BINS
    parts, seams, at = [], [], 0.0
    for leg in legs:
        count = max(1, round((leg.stopped - leg.started) / width))
        edges = np.linspace(leg.started, leg.stopped, count + 1)
        parts.append((at + edges - leg.started, *_shares(leg, edges, finished, seconds, rank)))
        at += leg.stopped - leg.started
        seams.append(at)
    shares = [np.concatenate([part[i] for part in parts]) for i in (1, 2, 3)]
    edges = np.concatenate([parts[0][0][:1], *(part[0][1:] for part in parts)])
    available = sum((leg.stopped - leg.started) * leg.ranks for leg in legs)
    ranks = np.repeat([leg.ranks for leg in legs], [len(part[1]) for part in parts])
    busy = float(np.sum(shares[0] * np.diff(edges) * ranks))
    return Load(edges, shares[0], shares[1], shares[2], seams[:-1], busy / available)


def _shares(
    leg: Leg, edges: Floats, finished: Floats, seconds: Floats, rank: NDArray[np.int64]
) -> tuple[Floats, Floats, Floats]:
    own = (finished > leg.started) & (finished <= leg.stopped)
    finished, seconds, rank = finished[own], seconds[own], rank[own]
    each = np.array(
        [
            busy_time(edges, finished[rank == one] - seconds[rank == one], finished[rank == one])
            for one in range(leg.ranks)
        ]
    ) / np.diff(edges)
    return each.mean(axis=0), each.min(axis=0), each.max(axis=0)


def busy_time(edges: Floats, begin: Floats, end: Floats) -> Floats:
    """Time within each interval that is in intervals of work, added up.

    Parameters
    ----------
    edges
        Shape (B + 1,), ascending.
    begin, end
        Of each of n pieces of work, shape (n,).

    Returns
    -------
    array, shape (B,)
    """
    return np.diff(_elapsed(edges, begin) - _elapsed(edges, end))


def _elapsed(at: Floats, times: Floats) -> Floats:
    """Sum of max(0, at − t) over all times t, for each `at`."""
    ordered = np.sort(times)
    before = np.searchsorted(ordered, at)
    # About the first edge, so that Unix times do not take the digits of milliseconds.
    sums = np.concatenate([[0.0], np.cumsum(ordered - at[0])])
    return before * (at - at[0]) - sums[before]


def draw_busy(ax: Any, found: Load | None) -> Any:
    """Draw the busy share of the ranks against time, and return the axes; None: nothing to draw."""
    grid(ax)
    ax.set_xlabel("wall-clock time, all legs (s)")
    ax.set_ylabel("time in which ranks simulate (%)")
    if found is None:
        say(ax, "no sample yet")
        return ax
    ax.stairs(
        100.0 * found.mean,
        found.edges,
        color=COLOURS[0],
        linewidth=1.3,
        baseline=None,
        label="all ranks",
    )
    if (found.most > found.least).any():
        ax.fill_between(
            found.edges,
            100.0 * np.append(found.least, found.least[-1]),
            100.0 * np.append(found.most, found.most[-1]),
            step="post",
            color=COLOURS[0],
            alpha=0.18,
            linewidth=0,
            label="idlest to busiest rank",
        )
    average = f"average {found.share:.1%}"
    ax.axhline(100.0 * found.share, color=COLOURS[1], linestyle="--", linewidth=1.2, label=average)
    for place, seam in enumerate(found.seams):
        name = "stopped and continued" if place == 0 else None
        ax.axvline(seam, color=COLOURS[6], linestyle=":", linewidth=1.2, label=name)
    ax.set_xlim(found.edges[0], found.edges[-1])
    ax.set_ylim(0.0, 103.0)
    legend_below(ax, 4)
    return ax


def of_data(data: CampaignData) -> Load | None:
    """Return how busy the ranks of a campaign were; None if no leg has a sample."""
    samples = data.all_sample_rows()
    finished = samples["finished"]
    legs = legs_of(data.legs(), finished)
    if not legs or not len(samples):
        return None
    return load(legs, finished, samples["seconds"], samples["rank"])


def pictures(data: CampaignData) -> Iterator[Picture]:
    """Yield the picture of a campaign, if it has samples."""
    found = of_data(data)
    if found is None:
        return

    def draw(figure: "matplotlib.figure.Figure") -> None:
        draw_busy(figure.subplots(), found)

    yield Picture(
        "busy",
        "Share of the time in which the ranks simulated, of all and of the idlest and busiest; "
        "compiling before the first sample, deciding and waiting are the rest.",
        draw,
        (7.2, 3.8),
    )
