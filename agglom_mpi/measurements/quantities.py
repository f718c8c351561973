"""Quantities that can be measured: one class each, and nothing else lists them.

A class states the name in a campaign file, the SI unit, limits, what the samples of a string
predict, how a figure shows it, and whether it may be measured next. To add a quantity, add a class.
"""

import math
from typing import ClassVar, Final, Literal, NamedTuple

import numpy as np

from agglom_mpi.declaration.components import Component
from agglom_mpi.declaration.needed import needed
from agglom_mpi.formatting import in_unit, value_with_prefix
from agglom_mpi.measurements.census import SampleSums, left_out_sums
from agglom_mpi.statistics import Floats

PARTICLE_WEIGHTS: Final = ("number", "area", "mass")
"""Weights of a particle in a distribution: 1, its surface, or its mass."""


class AssumedError(NamedTuple):
    """Standard error of a measurement: absolute in SI units, or relative to what is measured."""

    value: float
    is_relative: bool

    def at(self, predicted: float) -> float:
        """Return the standard error of a measurement of about the predicted value."""
        return self.value * abs(predicted) if self.is_relative else self.value

    def text(self, unit: str) -> str:
        """Return the error for people: `5 %` or `10 µm`."""
        if self.is_relative:
            return f"{100.0 * self.value:.3g} %"
        if unit == "m":
            return value_with_prefix(self.value, unit)
        return in_unit(f"{self.value:.3g}", unit)


class MeasuredQuantity(Component):
    """A quantity that can be measured.

    Attributes
    ----------
    unit
        SI unit of its values.
    has_weight
        Whether particles count by number, area or mass.
    usual_weight
        Weight where a campaign states none.
    most
        Largest possible value.
    needs_heat
        Whether only particles with a temperature have it.
    is_curve
        Whether its values are shares of classes of diameter, from a file.
    is_exact
        Whether the laws of the scene give its values, of single impacts from a file, without
        samples. A quantity that is neither is one number.
    share
        Share of the particles below it; None unless it is a quantile.
    next_weights
        Weights of the measurements that may be proposed next. Each number stands once: none is a
        function of another one. Empty if it is proposed under another name.
    assumed_error
        Error of a further measurement where the data have none of its kind.
    shown_as, factor
        Quantity that figures show in its place, and its size relative to that one: 0.5 of a radius.
    panel
        Label of its panel in figures over time, with a place for the weight; empty: its name.
    line_style
        Of its line in such a panel.
    """

    named_by: ClassVar[str] = "quantity"
    may_be_own: ClassVar[bool] = False
    unit: ClassVar[str] = "1"
    has_weight: ClassVar[bool] = False
    usual_weight: ClassVar[Literal["number", "area", "mass"]] = "number"
    most: ClassVar[float] = math.inf
    needs_heat: ClassVar[bool] = False
    is_curve: ClassVar[bool] = False
    is_exact: ClassVar[bool] = False
    share: ClassVar[float | None] = None
    next_weights: ClassVar[tuple[str, ...]] = ("number",)
    assumed_error: ClassVar[AssumedError] = AssumedError(0.05, is_relative=True)
    shown_as: ClassVar[str] = ""
    factor: ClassVar[float] = 1.0
    panel: ClassVar[str] = ""
    line_style: ClassVar[str] = "-"

    @property
    def summary(self) -> str:
        """Name of the measured quantity."""
        return str(type(self).__doc__)

    @needed
    def predict(self, sums: SampleSums, weight: str, edges: Floats | None) -> Floats:
        """Return the number by all samples, then without one each, shape (1 + n,).

        Shares of classes, which have `edges`, and values of impacts have the shape (1 + n, q).
        """
        raise NotImplementedError

    def at_start(self, grains: int, diameter: float, temperature: float) -> float:
        """Return the number at the start, of grains of a diameter in m; nan if it is not known."""
        return math.nan

    def one_name(self, weight: str) -> tuple[str, str]:
        """Return quantity and weight by the one name of all that are proportional to each other.

        A quantity without a weight is by number.
        """
        return self.name, weight if self.has_weight else "number"

    def within_limits(self, values: Floats, lengths: tuple[float, float]) -> Floats:
        """Return predicted values, (n, q), moved to the nearest ones that are possible.

        `lengths` are the smallest and the largest diameter of a particle in m.
        """
        return np.clip(values, 0.0, self.most)

    @property
    def errors_like(self) -> str:
        """Name of all quantities whose measurements have similar errors."""
        return "length" if self.unit == "m" else self.name

    @property
    def axis_unit(self) -> str:
        """SI unit of the axis on which a figure shows it: of shares that of the diameters."""
        return "m" if self.is_curve else "m/s" if self.is_exact else self.unit

    @property
    def one_value(self) -> str:
        """Word for one of its values, where it has several."""
        return "impact" if self.is_exact else "share"

    @property
    def has_file(self) -> bool:
        """Whether its values are in a file."""
        return self.is_curve or self.is_exact


class Sizes(MeasuredQuantity):
    """Shares of classes of diameter."""

    quantity: Literal["sizes"] = "sizes"
    has_weight = True
    usual_weight = "mass"
    is_curve = True
    next_weights = ()

    def predict(self, sums: SampleSums, weight: str, edges: Floats | None) -> Floats:
        """Shares of the pooled particles in the classes of the datum."""
        assert edges is not None
        return sums.shares(edges, weight)

    def within_limits(self, values: Floats, lengths: tuple[float, float]) -> Floats:
        """At least 0; shares keep their sum."""
        found = np.clip(values, 0.0, self.most)
        found *= values.sum(axis=1, keepdims=True) / found.sum(axis=1, keepdims=True)
        return found


class LengthOfParticles(MeasuredQuantity):
    """A length in m that lies between those of the smallest and the largest particle."""

    unit = "m"

    def at_start(self, grains: int, diameter: float, temperature: float) -> float:
        """Value of the grains."""
        return self.factor * diameter

    def within_limits(self, values: Floats, lengths: tuple[float, float]) -> Floats:
        """Between the lengths of the smallest and the largest particle."""
        return np.clip(values, self.factor * lengths[0], self.factor * lengths[1])


class Quantile(LengthOfParticles):
    """Diameter below which a share of the particles lies."""

    has_weight = True
    usual_weight = "mass"
    next_weights = PARTICLE_WEIGHTS
    panel = "diameters by {weight}"

    def predict(self, sums: SampleSums, weight: str, edges: Floats | None) -> Floats:
        """Quantile of the pooled particles."""
        assert self.share is not None
        return sums.quantile(self.share, weight)


class D10(Quantile):
    """Diameter below which 10 % lie."""

    quantity: Literal["d10"] = "d10"
    share = 0.1
    line_style = ":"


class D50(Quantile):
    """Median diameter."""

    quantity: Literal["d50"] = "d50"
    share = 0.5


class D90(Quantile):
    """Diameter below which 90 % lie."""

    quantity: Literal["d90"] = "d90"
    share = 0.9
    line_style = "--"


class D43(LengthOfParticles):
    """De Brouckere mean diameter D[4,3]."""

    quantity: Literal["d43"] = "d43"

    def predict(self, sums: SampleSums, weight: str, edges: Floats | None) -> Floats:
        """D[4,3]."""
        return mean_diameter(sums, "mass")


class D32(LengthOfParticles):
    """Sauter mean diameter D[3,2]."""

    quantity: Literal["d32"] = "d32"

    def predict(self, sums: SampleSums, weight: str, edges: Floats | None) -> Floats:
        """D[3,2]."""
        return mean_diameter(sums, "area")


class MeanLength(LengthOfParticles):
    """A mean length by any weight; those by area and mass are D[3,2] and D[4,3]."""

    has_weight = True
    panel = "mean diameter by {weight}"

    def predict(self, sums: SampleSums, weight: str, edges: Floats | None) -> Floats:
        """Mean diameter, or what is proportional to it."""
        return self.factor * mean_diameter(sums, weight)

    def one_name(self, weight: str) -> tuple[str, str]:
        """Name of the mean diameter by the weight."""
        name = {"area": D32.quantity, "mass": D43.quantity}.get(weight, MeanDiameter.quantity)
        return QUANTITIES[name].one_name(weight) if name != self.name else (name, weight)


class MeanDiameter(MeanLength):
    """Mean diameter."""

    quantity: Literal["mean_diameter"] = "mean_diameter"


class MeanRadius(MeanLength):
    """Mean radius."""

    quantity: Literal["mean_radius"] = "mean_radius"
    shown_as = MeanDiameter.quantity
    factor = 0.5
    next_weights = ()


class Spread(MeasuredQuantity):
    """Standard deviation of the diameters relative to their mean, by number."""

    quantity: Literal["spread"] = "spread"

    def predict(self, sums: SampleSums, weight: str, edges: Floats | None) -> Floats:
        """√(⟨d²⟩/⟨d⟩² − 1) of the pooled particles."""
        ratio = sums.power_sum(2) * sums.power_sum(0) / sums.power_sum(1) ** 2
        return np.sqrt(np.maximum(ratio - 1.0, 0.0))

    def at_start(self, grains: int, diameter: float, temperature: float) -> float:
        """0 of equal grains."""
        return 0.0 * diameter


class ParticlesLeft(MeasuredQuantity):
    """Number of particles relative to that of the grains at the start."""

    quantity: Literal["particles_left"] = "particles_left"
    most = 1.0

    def predict(self, sums: SampleSums, weight: str, edges: Floats | None) -> Floats:
        """Mean number of particles of a sample over that of its grains."""
        n = len(sums.counts)
        samples = np.concatenate([[n], np.full(n, n - 1)])
        return sums.power_sum(0) / (samples * sums.grains)

    def at_start(self, grains: int, diameter: float, temperature: float) -> float:
        """1."""
        return 1.0


class LargestMassFraction(MeasuredQuantity):
    """Mass of the largest particle relative to the total mass."""

    quantity: Literal["largest_mass_fraction"] = "largest_mass_fraction"
    most = 1.0

    def predict(self, sums: SampleSums, weight: str, edges: Floats | None) -> Floats:
        """Sum of the largest masses over that of all masses."""
        return left_out_sums(sums.largest) / left_out_sums(np.sum(sums.masses, axis=1))

    def at_start(self, grains: int, diameter: float, temperature: float) -> float:
        """One grain of all, if they are equal."""
        return 1.0 / grains if diameter > 0.0 else math.nan


class Temperature(MeasuredQuantity):
    """Mean temperature by mass."""

    quantity: Literal["temperature"] = "temperature"
    unit = "K"
    needs_heat = True
    assumed_error = AssumedError(1.0, is_relative=False)

    def predict(self, sums: SampleSums, weight: str, edges: Floats | None) -> Floats:
        """Mean of the samples, each by its mass."""
        masses = np.sum(sums.masses, axis=1)
        return left_out_sums(sums.temperatures * masses) / left_out_sums(masses)

    def at_start(self, grains: int, diameter: float, temperature: float) -> float:
        """Value of the grains."""
        return temperature


class CoefficientOfRestitution(MeasuredQuantity):
    """Coefficient of restitution of single impacts, 0 where the pair sticks."""

    quantity: Literal["restitution"] = "restitution"
    is_exact = True
    next_weights = ()

    def predict(self, sums: SampleSums, weight: str, edges: Floats | None) -> Floats:
        """Return what the laws of the string give without samples; `edges` are the impacts."""
        assert edges is not None
        assert sums.coefficients is not None
        return np.tile(sums.coefficients(edges), (1 + len(sums.counts), 1))


MEAN_POWERS: Final = {"number": (1, 0), "area": (3, 2), "mass": (4, 3)}
"""Powers of the two sums whose ratio is the mean diameter by a weight."""


def mean_diameter(sums: SampleSums, weight: str) -> Floats:
    """Return the mean diameter in m by a weight, shape (1 + n,)."""
    above, below = MEAN_POWERS[weight]
    return sums.power_sum(above) / sums.power_sum(below)


QUANTITIES: Final = {name: kind() for name, kind in MeasuredQuantity.components().items()}
"""The quantities by name, in the order of declaration."""
