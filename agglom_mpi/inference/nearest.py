"""The string that comes nearest to the members of a feasible set, which an empty set names."""

from typing import Any, Final, NamedTuple

import numpy as np

from agglom_mpi.formatting import in_unit, value_with_error
from agglom_mpi.inference.emulated_set import EmulatedSet

MAX_FAILING: Final = 0.5
"""Maximum probability of failure of the nearest string."""
MIN_AWAY_OUT_OF_REACH: Final = 1.645
"""Minimum distance, in standard deviations, of a mean that is out of reach at 95 %."""
MIN_DEVIATION: Final = 1e-300
"""Divisor in place of a standard deviation of 0."""
END_WIDTH: Final = 1e-3
"""Maximum distance from the end of a range, in units of the range, of a string at the end."""
QUANTITY_NAMES: Final = {"mean_radius_ratio": "mean b/b0", "objective": "value of the function"}
"""Names of compared quantities for a person, where the name of the column is not one."""


class NearestString(NamedTuple):
    """The string of the box whose emulated mean is nearest to the means of members.

    Attributes
    ----------
    parameters
        Searched variables by the campaign's names, in SI units.
    units
        Their units.
    ends
        End of the range, `lower` or `upper`, of each variable that is at one.
    probability
        Probability that the string is a member.
    mean, deviation
        Emulated mean of each quantity that is compared, by name, and its standard deviation.
    away
        Largest distance of a mean from the bounds, in these deviations; 0 within the bounds.
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
        return self.away > MIN_AWAY_OUT_OF_REACH

    @property
    def reached(self) -> str:
        """The emulated means as text: `mean b/b0 4.52 ± 0.12`."""
        return ", ".join(
            f"{quantity_name(name)} {value_with_error(mean, self.deviation[name])}"
            for name, mean in self.mean.items()
        )

    def __str__(self) -> str:
        values = (
            in_unit(f"{name} {value:.4g}", self.units[name])
            for name, value in self.parameters.items()
        )
        return f"{self.reached} at {', '.join(values)}"

    def as_dict(self) -> dict[str, Any]:
        """Return it as plain values."""
        return self._asdict()


def quantity_name(name: str) -> str:
    """Return the name of a compared quantity for a person."""
    return QUANTITY_NAMES.get(name, name)


def nearest_string(emulated: EmulatedSet) -> NearestString:
    """Return the string of the box that comes nearest to the members of a set."""
    candidates = emulated.near_best()
    points = emulated.coordinates.of_strings(candidates)
    alive = emulated.failing(points) <= MAX_FAILING
    candidates = candidates[alive] if alive.any() else candidates
    distances = emulated.criterion.distance(emulated.mean_only(candidates))
    string = candidates[[int(np.argmin(distances))]]
    mean, deviation = emulated.mean(string)[0], emulated.deviation(string)[0]
    box, quantities = emulated.box, emulated.criterion.quantities
    units = box.space.to_unit(string)[0]
    ends = {"lower": units <= END_WIDTH, "upper": units >= 1.0 - END_WIDTH}
    lower, upper = np.array(emulated.criterion.bands()).T
    beyond = np.maximum(np.maximum(lower - mean, mean - upper), 0.0)
    away = beyond / np.maximum(deviation, MIN_DEVIATION)
    return NearestString(
        {each.name: float(each.values(string)[0]) for each in box.own},
        {each.name: each.unit for each in box.own},
        {n: end for i, n in enumerate(box.names) for end, at in ends.items() if at[i]},
        float(emulated.probability(string)[0]),
        dict(zip(quantities, mean.tolist(), strict=True)),
        dict(zip(quantities, deviation.tolist(), strict=True)),
        float(np.nan_to_num(away, nan=np.inf).max()),
    )
