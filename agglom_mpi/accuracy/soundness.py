"""Soundness of the samples of one set-up: the checks that every sample must pass, and by how much.

A sample is sound if it completes, its energy ledger closes, no temperature is sent below zero,
every impact is solved, and no spheres overlap that should not. Some may: an aggregate is larger
than the spheres that bonded, so that it may reach into what is around it. If the two approach, that
is a contact at once; if they recede it is none, and they part.
"""

from collections.abc import Iterable, Mapping
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from agglom_mpi.accuracy.report import time_columns
from agglom_mpi.accuracy.study import Rows, completed
from agglom_mpi.analysis.tables import time_on_free_core
from agglom_mpi.config.campaign import Campaign
from agglom_mpi.formatting import format_percent
from agglom_mpi.outcome import REASONS, FailureReason
from agglom_mpi.statistics import mean_of

Floats = NDArray[np.float64]

ROUNDING: Final = 1e-12
"""Overlap relative to the distance of contact up to which spheres touch, as in the ledger."""


def overlaps_part(campaign: Campaign, samples: Iterable[int]) -> bool:
    """Return whether all spheres that overlap at the end of samples recede.

    Parameters
    ----------
    campaign
        A scene with fixed variables.
    samples
        Numbers of samples that complete.
    """
    from agglom_mpi.verbs.simulate import simulate

    string = campaign.at(campaign.parameters())
    scene, box = string.build(None), string.section.escape
    side = 2.0 * scene.half_width
    period = side if box.is_periodic() else np.inf
    images = box.image_offset(side, scene.end_time), box.flow_speed(side)
    for sample in samples:
        frames = simulate(campaign, {}, sample, frames=2).frames
        assert frames is not None
        count = int(frames.particles[-1])
        positions, velocities = frames.positions[-1][:count], frames.velocities[-1][:count]
        radii = frames.radii[-1][:count]
        if approaching_overlaps(positions, velocities, radii, period, images):
            return False
    return True


def approaching_overlaps(
    positions: Floats,
    velocities: Floats,
    radii: Floats,
    period: float,
    images: tuple[float, float] = (0.0, 0.0),
) -> int:
    """Return the number of pairs of spheres that overlap and approach each other.

    Parameters
    ----------
    positions, velocities
        In m and m/s, shape (n, 3).
    radii
        In m, shape (n,).
    period
        Edge of a periodic box in m; inf: there are no contacts across faces.
    images
        How far the image above a sheared box is ahead in m, and how much faster in m/s.
    """
    apart, relative = positions[:, None] - positions, velocities[:, None] - velocities
    if np.isfinite(period):
        above = np.round(apart[..., 1] / period)
        apart[..., 0] -= above * images[0]
        relative[..., 0] -= above * images[1]
        apart -= period * np.round(apart / period)
    contact = radii[:, None] + radii
    overlap = np.linalg.norm(apart, axis=-1) < contact * (1.0 - ROUNDING)
    approach = np.sum(apart * relative, axis=-1) < 0.0
    return int(np.triu(overlap & approach, 1).sum())


CLOSED: Final = 1e-9
"""Energy error up to which a sample's ledger counts as closed."""

EXHAUSTED: Final = "budget exhausted"
"""Kind of trouble of samples that took more steps or events than they may."""

FAILED: Final[Mapping[str, str]] = {
    REASONS[FailureReason.PLACEMENT_JAMMED]: "no place",
    REASONS[FailureReason.NON_FINITE]: "not finite",
    REASONS[FailureReason.BUDGET_EXCEEDED]: EXHAUSTED,
}
"""Kinds of trouble of samples that did not complete, by the reason."""

FAILED_OTHERWISE: Final = "failed"
"""Kind of trouble of samples that did not complete for any other reason."""

OVERLAPS: Final = "overlaps"
"""Kind of trouble of spheres that overlap at the end."""

KINDS: Final = (
    *FAILED.values(),
    FAILED_OTHERWISE,
    "unsolved impacts",
    "below 0 K",
    "energy not closed",
    OVERLAPS,
)
"""Kinds of trouble, the most serious first."""


def summary(rows: Rows) -> dict[str, Any]:
    """Return growth, ledger and times of the samples of one set-up, by column."""
    good = completed(rows)
    growth = mean_of(good["mean_radius_ratio"])
    failed = rows[rows["reason"] > 0]
    collisions = float(np.sum(good["collisions"]))
    return {
        "samples": len(rows),
        "failed": len(rows) - len(good),
        "reason": REASONS[int(failed["reason"][0])] if len(failed) else "",
        "mean b/b0": growth.value,
        "standard error": growth.error,
        "half width": growth.half_width,
        "collisions per sample": collisions / max(1, len(good)),
        "breakages per sample": float(np.sum(good["breakups"])) / max(1, len(good)),
        "unsolved impacts": float(np.sum(good["capped_iterations"])) / max(1.0, collisions),
        "temperatures below zero": float(np.mean(good["floored_temperatures"])) if len(good) else 0,
        "overlaps per sample": float(np.mean(good["overlaps"])) if len(good) else np.nan,
        "energy error": float(np.max(np.abs(good["energy_error"]))) if len(good) else np.nan,
        "momentum error": float(np.max(good["momentum_error"])) if len(good) else np.nan,
        **time_columns(time_on_free_core(rows)),
    }


def heaped_overlaps(reference: Mapping[str, Any]) -> float:
    """Return the overlaps per sample that heaps of pieces have, by the event engine's summary.

    Pieces of broken aggregates overlap what is around them until they have parted.
    """
    return float(reference["overlaps per sample"]) if reference["breakages per sample"] > 0 else 0.0


def troubles(found: Mapping[str, Any], heaped: float) -> dict[str, str]:
    """Return what is wrong with the samples of a set-up, by one of `KINDS`, with its extent.

    Parameters
    ----------
    found
        From `summary`.
    heaped
        Overlaps per sample to be expected; see `heaped_overlaps`.
    """
    wrong = {}
    if found["failed"]:
        kind = FAILED.get(found["reason"], FAILED_OTHERWISE)
        wrong[kind] = f"{found['failed']} of {found['samples']} samples failed ({found['reason']})"
    if found["unsolved impacts"] > 0:
        wrong["unsolved impacts"] = (
            f"{format_percent(found['unsolved impacts'])} of impacts unsolved"
        )
    if found["temperatures below zero"] > 0:
        wrong["below 0 K"] = "temperatures below zero"
    any_completed = found["failed"] < found["samples"]
    if any_completed and not found["energy error"] <= CLOSED:  # nan does not close either
        wrong["energy not closed"] = f"energy error {found['energy error']:.1g}"
    overlaps = found["overlaps per sample"]
    if overlaps - heaped >= 0.5:
        wrong[OVERLAPS] = (
            f"{overlaps:.0f} overlaps" if overlaps >= 10 else f"{overlaps:.2g} overlaps"
        )
    return wrong
