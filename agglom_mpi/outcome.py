"""The result of one sample: its columns, failure reasons, summary for decisions, particles left."""

import math
from collections.abc import Mapping, Sequence
from enum import IntEnum
from itertools import repeat
from typing import Any, Final, NamedTuple

import numpy as np
import numpy.typing as npt

from agglom_mpi.formatting import pluralise

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
"""Texts of the reasons, by their numbers."""


class FailureReason(IntEnum):
    """Why a sample failed, the column `reason`; it is 0 where a sample did not fail."""

    PLACEMENT_JAMMED = 1
    NON_FINITE = 2
    BUDGET_EXCEEDED = 3
    EXCEPTION = 4
    TIMED_OUT = 5


class OutcomeColumn(NamedTuple):
    """One result column of a sample: name, storage type, unit and meaning.

    `since` is the format version of campaign files that first has it.
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
"""One sample as a structured scalar, fields in the order of `COLUMNS`."""

SPIN_COLUMNS: Final = (
    OutcomeColumn(
        "angular_momentum_left", "f8", "kg*m^2/s", "angular momentum that no rotation has taken up"
    ),
    OutcomeColumn(
        *("granular_temperature", "f8", "m^2/s^2"),
        "2/3 of the kinetic energy of the motion at the end, about the mean flow, over the mass",
    ),
    OutcomeColumn(
        *("rotational_temperature", "f8", "m^2/s^2"),
        "2/3 of the kinetic energy of the rotation at the end, over the mass",
    ),
    OutcomeColumn("spin_caps", "f8", "1", "merges and breakups that left angular momentum"),
)
"""Further columns of a sample whose grains spin, by name; other samples have none of them."""

SPIN_UNITS: Final = {column.name: column.unit for column in SPIN_COLUMNS}
"""Their units: a campaign file has them among the quantities of a sample."""

# They come first: Numba takes a record for another that begins with all of its fields.
_SPINNING: Final = np.dtype([*((c.name, c.dtype) for c in SPIN_COLUMNS), *OUTCOME.descr])


def outcome_type(spins: bool) -> np.dtype[np.void]:
    """Return the type of the result of a sample: `OUTCOME`, and `SPIN_COLUMNS` with `spins`."""
    return _SPINNING if spins else OUTCOME


LEDGER: Final = (
    "momentum_error",
    "energy_error",
    "capped_iterations",
    "largest_residual",
    "floored_temperatures",
    "overlaps",
)
"""Columns that say how exact a sample is; near 0 if it is."""

SUMMED: Final = (
    *("steps", "particle_steps", "collisions", "merges", "breakups"),
    *("capped_iterations", "floored_temperatures", "overlaps"),
)
"""Columns of a sample with several experiments that are sums over these."""
MAXIMA: Final = "momentum_error", "energy_error", "largest_residual"
"""Columns of such a sample that are the largest of its experiments."""


def joined(records: npt.NDArray[np.void]) -> np.void:
    """Return the result of a sample by those of its experiments, `OUTCOME`, shape (n,).

    It fails where one of them does. What is neither a sum nor a maximum is that of the first.
    """
    whole = records[:1].copy()
    for name in SUMMED:
        whole[name] = records[name].sum()
    for name in MAXIMA:
        whole[name] = records[name].max()
    failed = records[records["state"] != COMPLETED]
    if len(failed):
        whole["state"], whole["reason"] = failed["state"][0], failed["reason"][0]
    return whole[0]


def same_values(one: tuple[Any, ...], other: object) -> bool:
    """Return whether two tuples of a kind hold the same values; arrays by their elements.

    nan is the same as nan, so that two runs of one sample are equal.
    """
    if type(one) is not type(other):
        return False
    return all(map(_same, one, other))


def _same(one: Any, other: Any) -> bool:
    if isinstance(one, np.ndarray) or isinstance(other, np.ndarray):
        numbers = getattr(one, "dtype", np.dtype("O")).kind in "fc"
        return np.array_equal(one, other, equal_nan=numbers)
    return bool(one == other) or (one != one and other != other)


def brief(name: str, values: Mapping[str, Any]) -> str:
    """Return values as `Name(number=1.5, array=<3 values, 1 to 2.5>)`, arrays in few words."""
    return f"{name}({', '.join(f'{key}={_brief(value)}' for key, value in values.items())})"


def _brief(value: Any) -> str:
    if isinstance(value, dict):
        return "{" + ", ".join(f"{key}: {_brief(part)}" for key, part in value.items()) + "}"
    if isinstance(value, np.ndarray):
        known = value[value == value]
        if value.size and not known.size:
            return "<none>"
        ends = f", {known.min():.4g} to {known.max():.4g}" if value.size else ""
        return f"<{pluralise(value.size, 'value')}{ends}>"
    return f"{value:.6g}" if isinstance(value, float) else str(value)


def quantity_columns(name: str) -> tuple[str, str, str, str]:
    """Return the columns of a quantity in tables of strings.

    Its mean and the standard error of that over the samples used, then over the fresh samples.
    """
    error = f"{name}_standard_error"
    return name, error, f"estimate_{name}", f"estimate_{error}"


class SampleSummary(NamedTuple):
    """What decisions are based on: a sample's state, moments of b/b0, effort and objective."""

    completed: bool
    mean_radius_ratio: float
    particles: int
    central_moments: tuple[float, float, float]
    """Central moments 2, 3, 4 of b/b0 over the particles left  [A 24]."""
    steps: int
    particle_steps: int
    objective: float = math.nan
    """Objective of this sample alone; nan where it was not computed."""
    quantities: tuple[float, ...] = ()
    """Quantities that the objective's function returned, in the order of their columns."""
    census: Any = None
    """Values of the columns of its censuses; None where they are not needed."""


def summaries(rows: npt.NDArray[np.void], quantities: Sequence[str] = ()) -> list[SampleSummary]:
    """Return the summaries of samples.

    Parameters
    ----------
    rows
        Structured array, shape (n,), with the fields of `OUTCOME`; a field `objective` is read if
        it is there.
    quantities
        Columns of the quantities that the objective's function returned.
    """
    columns = [rows[name].tolist() for name in ("mean_radius_ratio", "particles")]
    moments = (rows[f"radius_moment_{r}"].tolist() for r in (2, 3, 4))
    effort = [rows[name].tolist() for name in ("steps", "particle_steps")]
    completed = (rows["state"] == COMPLETED).tolist()
    has_objective = "objective" in (rows.dtype.names or ())
    objectives = rows["objective"].tolist() if has_objective else repeat(math.nan)
    returned = zip(*(rows[name].tolist() for name in quantities), strict=True)
    each = returned if quantities else repeat(())
    return list(
        map(
            SampleSummary,
            *(completed, *columns, zip(*moments, strict=True), *effort, objectives, each),
        )
    )


FAILED_SUMMARY: Final = SampleSummary(False, 0.0, 0, (0.0, 0.0, 0.0), 0, 0, 0.0)
"""Summary of any sample that failed."""


class FinalParticles(NamedTuple):
    """The n particles left at the end, in the order of their slots.

    The order is the same for every run of a sample: grains start in the order of placement; of two
    that bond, one keeps its slot (with the event engine the lower); gaps close up; fragments are
    appended. The event engine may sort more than 4096 particles by position.

    Attributes
    ----------
    radii, masses, temperatures : array, shape (n,), m, kg and K
    grains : array of int64, shape (n,), original grains in each
    spins : array, shape (n, 3), rad/s
        None where grains do not spin.
    """

    radii: npt.NDArray[np.float64]
    masses: npt.NDArray[np.float64]
    grains: npt.NDArray[np.int64]
    temperatures: npt.NDArray[np.float64]
    spins: npt.NDArray[np.float64] | None = None


def final_particles(scene: Any, particles: Any) -> FinalParticles:
    """Return copies of the particles left at the end of a sample.

    Where the kernels did not count grains, they follow from the mass; where nothing changes
    temperatures, all are the scene's.

    Parameters
    ----------
    scene
        The `Scene` that was simulated.
    particles
        Its final `Particles`.
    """
    left = int(particles.size[0])
    masses = np.array(particles.mass[:left])
    has_temperatures, has_grains = particles.temperature is not None, particles.grains is not None
    return FinalParticles(
        radii=np.array(particles.radius[:left]),
        masses=masses,
        grains=(
            np.array(particles.grains[:left])
            if has_grains
            else np.rint(masses / scene.mass).astype(np.int64)
        ),
        temperatures=(
            np.array(particles.temperature[:left])
            if has_temperatures
            else np.full(left, scene.temperature)
        ),
        spins=None if particles.spin is None else particles.spin[:, :left].T.copy(),
    )
