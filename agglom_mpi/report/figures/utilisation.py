"""Utilisation of the ranks over time, from the end and the duration of each sample."""

from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from agglom_mpi.report.figures.figure import Figure
from agglom_mpi.report.style import COLOURS, PAGE, legend_below
from agglom_mpi.storage.reader import CampaignData

Floats = NDArray[np.float64]

BINS: Final = 120
"""Intervals of time, about."""


Leg = tuple[float, float, int]
"""One start of the program: Unix times of its start and end in s, and its ranks."""


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
            legs.append((float(row["started"]), end, int(row["ranks"])))
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
    width = sum(stopped - started for started, stopped, _ in legs) / BINS
    edges, shares, boundaries, simulating, available = [np.zeros(1)], [], [], 0.0, 0.0
    begin = 0.0
    for started, stopped, ranks in legs:
        count = max(1, round((stopped - started) / width))
        own = np.linspace(started, stopped, count + 1)
        here = (finished > started) & (finished <= stopped)
        ends, lengths, of = finished[here], seconds[here], rank[here]
        busy = [
            busy_time(own, ends[of == one] - lengths[of == one], ends[of == one])
            for one in range(ranks)
        ]
        each = np.array(busy) / np.diff(own)
        shares.append([each.mean(axis=0), each.min(axis=0), each.max(axis=0)])
        edges.append(begin + own[1:] - started)
        simulating += float(np.sum(shares[-1][0] * np.diff(own))) * ranks
        available += (stopped - started) * ranks
        begin += stopped - started
        boundaries.append(begin)
    overall = simulating / available
    mean, least, most = np.concatenate(shares, axis=1)
    return Utilisation(np.concatenate(edges), mean, least, most, boundaries[:-1], overall)


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
    ax.set_xlabel("wall-clock time, all legs (s)")
    ax.set_ylabel("time in which ranks simulate (%)")
    line = {"color": COLOURS[0], "linewidth": 1.3, "baseline": None, "label": "all ranks"}
    ax.stairs(100.0 * found.mean, found.edges, **line)
    if (found.most > found.least).any():
        ends = (100.0 * np.append(each, each[-1]) for each in (found.least, found.most))
        band = {"step": "post", "color": COLOURS[0], "alpha": 0.18, "linewidth": 0}
        ax.fill_between(found.edges, *ends, label="idlest to busiest rank", **band)
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
    (PAGE, 3.2),
    empty="no sample yet",
    method="plot_busy",
    meaning="Draw the share of the time in which the ranks simulated.",
)
