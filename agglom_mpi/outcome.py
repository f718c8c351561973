"""What one sample leaves behind: the record that travels from a rank to the campaign file."""

import math
from itertools import repeat
from typing import Any, Final, NamedTuple

import numpy as np
import numpy.typing as npt

COMPLETED: Final = 1
FAILED: Final = 2

REASONS: Final = (
    "",
    "placement: no free place was found for every sphere",
    "non-finite state",
    "budget of steps or events exceeded",
    "exception",
    "took longer than max_seconds",
)
"""Why a sample failed, by the `reason` of its record."""
PLACEMENT_JAMMED: Final = 1
NON_FINITE: Final = 2
BUDGET_EXCEEDED: Final = 3
EXCEPTION: Final = 4
TIMED_OUT: Final = 5


class OutcomeColumn(NamedTuple):
    """One measured quantity of a sample: its storage type, unit and meaning.

    Campaign files have it from the format version `since` on.
    """

    name: str
    dtype: str
    unit: str
    meaning: str
    since: int = 1


COLUMNS: Final = (
    OutcomeColumn("state", "u1", "", "1 completed, 2 failed"),
    OutcomeColumn("reason", "u1", "", "why it failed, 0 if it did not"),
    OutcomeColumn("mean_radius_ratio", "f8", "1", "mean of b/b0 over the particles left"),
    OutcomeColumn(
        "radius_moment_2", "f8", "1", "second central moment of b/b0 over the particles left"
    ),
    OutcomeColumn("radius_moment_3", "f8", "1", "third central moment of b/b0"),
    OutcomeColumn("radius_moment_4", "f8", "1", "fourth central moment of b/b0"),
    OutcomeColumn("mean_temperature", "f8", "K", "mass-weighted mean temperature at the end"),
    OutcomeColumn("end_time", "f8", "s", "simulated time"),
    OutcomeColumn("particles", "i8", "1", "particles left"),
    OutcomeColumn("steps", "i8", "1", "time steps taken, or events of the event engine"),
    OutcomeColumn(
        "particle_steps",
        "i8",
        "1",
        "particles present, summed over the time steps; 0 with the event engine",
    ),
    OutcomeColumn("collisions", "i8", "1", "impacts resolved, merges included"),
    OutcomeColumn("merges", "i8", "1", "impacts that bonded"),
    OutcomeColumn("breakups", "i8", "1", "aggregates that fragmented"),
    OutcomeColumn(
        "momentum_error", "f8", "1", "momentum change over sum of m|v|, centre-of-mass frame"
    ),
    OutcomeColumn("energy_error", "f8", "1", "energy imbalance over the energy that flowed"),
    OutcomeColumn(
        "capped_iterations", "i8", "1", "impacts whose solver ended at its iteration cap"
    ),
    OutcomeColumn("largest_residual", "f8", "1", "largest |e - G(e)| an impact was left with"),
    OutcomeColumn(
        "floored_temperatures", "i8", "1", "temperatures that a heating law sent below zero"
    ),
    OutcomeColumn("overlaps", "i8", "1", "pairs that overlap at the end"),
)
"""The columns of a sample that physics determines; bit-for-bit reproducible."""

OUTCOME: Final = np.dtype([(column.name, column.dtype) for column in COLUMNS])
"""One sample as a structured scalar; ledger columns end it."""

LEDGER: Final = (
    "momentum_error",
    "energy_error",
    "capped_iterations",
    "largest_residual",
    "floored_temperatures",
    "overlaps",
)
"""Columns that say how exact a sample is; near 0 if it is."""


class SampleSummary(NamedTuple):
    """What of a sample decisions are made from."""

    completed: bool
    mean_radius_ratio: float
    particles: int
    central_moments: tuple[float, float, float]
    """Moments 2, 3, 4 of b/b0 over the particles left."""
    steps: int
    particle_steps: int
    objective: float = math.nan
    """Of this sample alone; nan where it was not asked for."""


def summaries(rows: npt.NDArray[np.void]) -> list[SampleSummary]:
    """Read rows, shape (n,), that have the columns of `OUTCOME` and, perhaps, `objective`."""
    columns = [rows[name].tolist() for name in ("mean_radius_ratio", "particles")]
    moments = (rows[f"radius_moment_{r}"].tolist() for r in (2, 3, 4))
    work = [rows[name].tolist() for name in ("steps", "particle_steps")]
    completed = (rows["state"] == COMPLETED).tolist()
    judged = "objective" in (rows.dtype.names or ())
    worth = rows["objective"].tolist() if judged else repeat(math.nan)
    return list(map(SampleSummary, completed, *columns, zip(*moments, strict=True), *work, worth))


FAILED_SUMMARY: Final = SampleSummary(False, 0.0, 0, (0.0, 0.0, 0.0), 0, 0, 0.0)
"""A sample that failed."""


class FinalParticles(NamedTuple):
    """The n particles left at the end, in the order of their slots.

    Grains start in the order of their placement. Two that bond go on in the slot of one of them,
    with the event engine the lower; gaps close up; pieces are put at the end. More than 4096 the
    event engine may sort by their place. So one sample always has one order.

    Attributes
    ----------
    radii, masses, temperatures : array, shape (n,), m, kg and K
    grains : array of int64, shape (n,), original grains in each
    """

    radii: npt.NDArray[np.float64]
    masses: npt.NDArray[np.float64]
    grains: npt.NDArray[np.int64]
    temperatures: npt.NDArray[np.float64]


def final_particles(scene: Any, particles: Any) -> FinalParticles:
    """Copy what is left of a `Scene` at its end, its final `Particles`, for people and files.

    Grains that the scene did not count are told by mass; temperatures that nothing changes are all
    the scene's.
    """
    left = int(particles.size[0])
    masses = np.array(particles.mass[:left])
    warms, counts = particles.temperature is not None, particles.grains is not None
    return FinalParticles(
        radii=np.array(particles.radius[:left]),
        masses=masses,
        grains=(
            np.array(particles.grains[:left])
            if counts
            else np.rint(masses / scene.mass).astype(np.int64)
        ),
        temperatures=(
            np.array(particles.temperature[:left]) if warms else np.full(left, scene.temperature)
        ),
    )
