"""The string that comes nearest to what a feasible set asks for, which an empty set names."""

from typing import TYPE_CHECKING, Any, Final, NamedTuple

import numpy as np

from agglom_mpi.formatting import value_with_error
from agglom_mpi.inference.set_points import near_best

if TYPE_CHECKING:
    from agglom_mpi.inference.feasible_set import FeasibleSet

MOST_FAILING: Final = 0.5
"""Probability of failure above which a string is not the nearest one."""
SURELY: Final = 1.645
"""Minimum distance, in deviations, of a mean that is out of reach at 95 %."""
TINY: Final = 1e-300
AT_END: Final = 1e-3
"""Distance from the end of a range, in units of the range, within which a string is at the end."""
QUANTITY_NAMES: Final = {"mean_radius_ratio": "mean b/b0", "objective": "value of the function"}
"""Names of compared quantities for a person, where the name of the column is not one."""


class NearestString(NamedTuple):
    """The string of the box whose emulated mean is nearest to that of members.

    Attributes
    ----------
    parameters
        Searched variables by the campaign's names, SI units.
    units
        Their units.
    ends
        Of those that are at an end of their range, which one: `lower` or `upper`.
    probability
        That it is a member.
    mean, deviation
        Emulated mean of what is compared, by name, and how unsure the emulator is of it.
    away
        By how many of these deviations the mean is out of what is asked for; 0 within.
    """

    parameters: dict[str, float]
    units: dict[str, str]
    ends: dict[str, str]
    probability: float
    mean: dict[str, float]
    deviation: dict[str, float]
    away: float

    @property
    def out_of_reach(self) -> bool:
        """Whether the string is surely no member; otherwise the emulator is too uncertain."""
        return self.away > SURELY

    @property
    def reached(self) -> str:
        """The emulated means as text: `mean b/b0 4.52 ± 0.12`."""
        return ", ".join(
            f"{quantity_name(name)} {value_with_error(mean, self.deviation[name])}"
            for name, mean in self.mean.items()
        )

    def __str__(self) -> str:
        values = (
            f"{name} {value:.4g}" + ("" if self.units[name] == "1" else f" {self.units[name]}")
            for name, value in self.parameters.items()
        )
        return f"{self.reached} at {', '.join(values)}"

    def as_dict(self) -> dict[str, Any]:
        """Return it as plain values."""
        return self._asdict()


def quantity_name(name: str) -> str:
    """Return the name of a compared quantity for a person."""
    return QUANTITY_NAMES.get(name, name)


def nearest(of: "FeasibleSet") -> NearestString:
    """Return the string of the box that comes nearest to the members of a set."""
    candidates = near_best(of, of.evaluated)
    alive = of.failing_of(candidates) <= MOST_FAILING
    candidates = candidates[alive] if alive.any() else candidates
    compared = of.emulator.mean_only(of.coordinates.of_strings(candidates))
    string = candidates[[int(np.argmin(of.criterion.distance(compared)))]]
    point = of.coordinates.of_strings(string)
    mean, deviation = of.emulator.mean(point)[0], of.emulator.deviation(point)[0]
    units = of.campaign.variables.space().to_unit(string)[0]
    ends = {"lower": units <= AT_END, "upper": units >= 1.0 - AT_END}
    quantities = of.criterion.quantities
    lower, upper = np.array(of.criterion.bands(of.maximum[0] if of.near_maximum else np.nan)).T
    away = np.maximum(np.maximum(lower - mean, mean - upper), 0.0) / np.maximum(deviation, TINY)
    return NearestString(
        {each.name: float(each.values(string)[0]) for each in of.own},
        {each.name: each.unit for each in of.own},
        {n: end for i, n in enumerate(of.names) for end, at in ends.items() if at[i]},
        float(of.probability_of(string)[0]),
        dict(zip(quantities, mean.tolist(), strict=True)),
        dict(zip(quantities, deviation.tolist(), strict=True)),
        float(np.nan_to_num(away, nan=np.inf).max()),
    )
