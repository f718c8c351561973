"""One measured mean: its density, given the string, and what predicts a further measurement."""

import math
from collections.abc import Iterator
from typing import Any, Final

import numpy as np

from agglom_mpi.emulation.gaussian_process import Floats
from agglom_mpi.inference.draw_groups import Observed
from agglom_mpi.inference.emulated_box import EmulatedStrings
from agglom_mpi.inference.emulated_set import EmulatedSet

MAX_AWAY: Final = 6.0
"""Distance from the measured mean, in standard deviations, beyond which a string has no weight."""


class MeasuredMean:
    """Density of a measured mean, given the string.

    It is what `EmulatedData` is for data, of the one number that a set compares. That number is
    emulated as it is, by the emulator of the set, so it has formulas of its own. Its variance is
    the square of the error plus that of the emulated mean; the noise of samples is in the error.

    Parameters
    ----------
    emulated
        The emulated set.
    measured, error
        The measured mean and its standard error.
    """

    given = "a measured mean"

    def __init__(self, emulated: EmulatedSet, measured: float, error: float) -> None:
        self.box, self.coordinates = emulated.box, emulated.coordinates
        self.quantity, self.criterion_text = (
            emulated.criterion.quantities[0],
            emulated.criterion.text,
        )
        self.measured, self.error = measured, error
        self._emulated = emulated
        self._reach = MAX_AWAY * math.hypot(error, float(emulated.prior[1].deviations.max()))

    def log_density(self, strings: Floats) -> Floats:
        """Return the logarithm of the density given strings, (n, k), but for a constant, (n,)."""
        return self.log_density_at(self._emulated.at(strings))

    def log_density_at(self, at: EmulatedStrings) -> Floats:
        """Return the same of emulated strings, (n,)."""
        variance, alive = self.error**2 + at.deviations[:, 0] ** 2, 1.0 - at.failing
        with np.errstate(divide="ignore"):
            return np.asarray(
                np.log(alive)
                - 0.5 * (self.measured - at.means[:, 0]) ** 2 / variance
                - 0.5 * np.log(variance)
            )

    def near(self, strings: Floats) -> Floats:
        """Return those of strings, (n, k), whose emulated mean is within reach."""
        means = self._emulated.mean_only(strings)[:, 0]
        return strings[np.abs(means - self.measured) <= self._reach]

    def entries(self) -> dict[str, Any]:
        """Return what was measured as plain values."""
        return {"measured": self.measured, "error": self.error}

    def observed(self) -> Iterator[Observed]:
        """Yield the measured mean for an ArviZ file."""
        label = "mean b/b0" if self.quantity == "mean_radius_ratio" else self.quantity
        values, errors = np.array([self.measured]), np.array([self.error])
        meaning = {"units": "1", "long_name": label}
        yield Observed(self.quantity, "measurement", values, errors, meaning)

    def measurements(
        self, strings: Floats, random: np.random.Generator, given: bool
    ) -> list[Floats]:
        """Return one further measurement for strings, (n, k): a list of one (n, 1).

        The error of the emulator at a string is the same for every measurement. Where the measured
        mean is `given`, it narrows it down, too.
        """
        known = self._emulated.at(strings)
        mean, deviation = known.means[:, 0], known.deviations[:, 0]
        if given:
            share = deviation**2 / (deviation**2 + self.error**2)
            mean = mean + share * (self.measured - mean)
            deviation = self.error * np.sqrt(share)
        return [random.normal(mean, np.hypot(deviation, self.error))[:, None]]
