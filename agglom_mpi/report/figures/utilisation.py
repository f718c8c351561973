"""Utilisation of the ranks over time, from the end and the duration of each sample."""

from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from agglom_mpi.report.drawing import COLOURS, legend_below, style_axes
from agglom_mpi.report.figures.figure import Figure
from agglom_mpi.storage.reader import CampaignData

Floats = NDArray[np.float64]

BINS: Final = 120
"""Intervals of time, about."""


class Leg(NamedTuple):
    """One start of the program: Unix times of its start and end in s, and its ranks."""

    started: float
    stopped: float
    ranks: int


class Utilisation(NamedTuple):
    """Share of the time in which ranks simulated, in B intervals of the time of all legs.

    Attributes
    ----------
    edges
        Ends of the intervals of wall-clock time, without the gaps between legs, s, shape (B + 1,).
    mean, least, most
        Share of all ranks, of the idlest and of the busiest, shape (B,).
    leg_boundaries
        Times at which one leg ended and the next began, s.
    overall
        Share of all ranks over the whole time.
    """

    edges: Floats
    mean: Floats
    least: Floats
    most: Floats
    leg_boundaries: list[float]
    overall: float


def legs_of(rows: np.ndarray, finished: Floats) -> list[Leg]:
    """Return the legs in rows of `/legs`; one without an end lasts until its last sample.

    Parameters
    ----------
    rows
        Of `/legs`.
    finished
        Unix times at which the samples ended, s, shape (n,).
    """
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


def utilisation(
    legs: list[Leg], finished: Floats, seconds: Floats, rank: NDArray[np.int64]
) -> Utilisation:
    """Return the utilisation of the ranks over some 120 intervals of all legs.

    Parameters
    ----------
    legs
        At least one.
    finished, seconds, rank
        Unix time at which each of n samples ended (s), its duration (s) and the rank that
        simulated it, shape (n,).
    """
    width = sum(leg.stopped - leg.started for leg in legs) / BINS
    parts, boundaries, begin = [], [], 0.0
    for leg in legs:
        count = max(1, round((leg.stopped - leg.started) / width))
        edges = np.linspace(leg.started, leg.stopped, count + 1)
        parts.append((begin + edges - leg.started, *_shares(leg, edges, finished, seconds, rank)))
        begin += leg.stopped - leg.started
        boundaries.append(begin)
    mean, least, most = (np.concatenate([part[i] for part in parts]) for i in (1, 2, 3))
    edges = np.concatenate([parts[0][0][:1], *(part[0][1:] for part in parts)])
    available = sum((leg.stopped - leg.started) * leg.ranks for leg in legs)
    ranks = np.repeat([leg.ranks for leg in legs], [len(part[1]) for part in parts])
    simulating = float(np.sum(mean * np.diff(edges) * ranks))
    return Utilisation(edges, mean, least, most, boundaries[:-1], simulating / available)


def _shares(
    leg: Leg, edges: Floats, finished: Floats, seconds: Floats, rank: NDArray[np.int64]
) -> tuple[Floats, Floats, Floats]:
    """Return mean, least and most utilisation of the ranks of a leg, B shares each."""
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
    """Return the time within each interval that samples take, added up.

    Parameters
    ----------
    edges
        Ends of the intervals, ascending, s, shape (B + 1,).
    begin, end
        Of each of n samples, s, shape (n,).

    Returns
    -------
    array, shape (B,)
        s.
    """
    return np.diff(_elapsed(edges, begin) - _elapsed(edges, end))


def _elapsed(at: Floats, times: Floats) -> Floats:
    """Return the sum of max(0, at − t) over all times t, for each `at`."""
    ordered = np.sort(times)
    before = np.searchsorted(ordered, at)
    # About the first edge, so that Unix times do not take the digits of milliseconds.
    sums = np.concatenate([[0.0], np.cumsum(ordered - at[0])])
    return before * (at - at[0]) - sums[before]


def draw_utilisation(ax: Any, found: Utilisation) -> Any:
    """Draw the utilisation of the ranks against time, and return the axes."""
    style_axes(ax)
    ax.set_xlabel("wall-clock time, all legs (s)")
    ax.set_ylabel("time in which ranks simulate (%)")
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
    label = f"average {found.overall:.1%}"
    ax.axhline(100.0 * found.overall, color=COLOURS[1], linestyle="--", linewidth=1.2, label=label)
    for place, boundary in enumerate(found.leg_boundaries):
        name = "stopped and continued" if place == 0 else None
        ax.axvline(boundary, color=COLOURS[6], linestyle=":", linewidth=1.2, label=name)
    ax.set_xlim(found.edges[0], found.edges[-1])
    ax.set_ylim(0.0, 103.0)
    legend_below(ax, 4)
    return ax


def utilisation_of(data: CampaignData) -> Utilisation | None:
    """Return the utilisation of a campaign's ranks; None if no leg has a sample."""
    samples = data.all_sample_rows()
    legs = legs_of(data.legs(), samples["finished"])
    if not legs or not len(samples):
        return None
    return utilisation(legs, samples["finished"], samples["seconds"], samples["rank"])


Figure(
    "busy",
    "run",
    0,
    lambda data, _: utilisation_of(data),
    draw_utilisation,
    "Share of the time in which the ranks simulated, of all and of the idlest and busiest; "
    "compiling before the first sample, deciding and waiting are the rest.",
    (7.2, 3.8),
    empty="no sample yet",
    method="plot_busy",
    meaning="Draw the share of the time in which the ranks simulated.",
)
