"""How pooled moments vary with the samples they are pooled of: the delta method for ratios.

The moments of all particles are functions of the samples' means of a few numbers: particles left,
and the sums of the powers of their radii. So their standard errors follow from the covariance of
these numbers between samples, which is kept up to date in constant time.
"""

import math
from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from agglom_mpi.simulation.outcome import Measured

Central = tuple[float, float, float]


class PowerSums:
    """Means over samples, and covariance, of (mean b/b⁰, n, S1, S2, S3, S4).

    S_r is the sum over the n particles of a sample of (b/b⁰ - c)^r; c is the mean of the first
    sample, so that little cancels.
    """

    def __init__(self) -> None:
        self.count = 0
        self._origin = 0.0
        self._means = np.zeros(6)
        self._products = np.zeros((6, 6))

    def add(self, outcome: Measured) -> None:
        """Take one more sample."""
        if self.count == 0:
            self._origin = outcome.mean_radius_ratio
        self.count += 1
        numbers = self._numbers(outcome)
        step = numbers - self._means
        self._means += step / self.count
        self._products += np.outer(step, numbers - self._means)

    def standard_error(self, slopes: Mapping[str, float], central: Central) -> float:
        """Return the standard error of a function of the moments; needs two samples.

        Parameters
        ----------
        slopes
            Its derivatives by `mean`, the mean over samples, and by the central moments `second`,
            `third` and `fourth` of all particles.
        central
            These three moments.
        """
        along = self._gradient(slopes, central)
        squares = max(0.0, float(along @ self._products @ along))
        return math.sqrt(squares / (self.count - 1) / self.count)

    def influence(self, outcome: Measured, slopes: Mapping[str, float], central: Central) -> float:
        """Return how far one sample moves such a function, times the number of samples."""
        away = self._numbers(outcome) - self._means
        return float(self._gradient(slopes, central) @ away)

    def _numbers(self, outcome: Measured) -> NDArray[np.float64]:
        n, (second, third, fourth) = outcome.particles, outcome.central_moments
        ratio = outcome.mean_radius_ratio
        d = ratio - self._origin
        about_origin = (
            d,
            second + d**2,
            third + 3.0 * d * second + d**3,
            fourth + 4.0 * d * third + 6.0 * d**2 * second + d**4,
        )
        return np.array([ratio, n, *(n * power for power in about_origin)])

    def _gradient(self, slopes: Mapping[str, float], central: Central) -> NDArray[np.float64]:
        """Return the derivatives by the six means, shape (6,).

        With D the distance of the common mean from c, the sums about that mean are binomial sums of
        S_r; that mean itself moves with S1 - D n, which changes moment r by -r M_{r-1}.
        """
        m2, m3, m4 = central
        n, distance = self._means[1], self._means[2] / self._means[1]
        a, b, c = (slopes.get(name, 0.0) / n for name in ("second", "third", "fourth"))
        d, d2, d3 = distance, distance**2, distance**3
        return np.array(
            [
                slopes.get("mean", 0.0),
                a * (d2 - m2) + b * (3.0 * d * m2 - d3 - m3) + c * (d2 * d2 + 4.0 * d * m3 - m4),
                -2.0 * a * d + 3.0 * b * (d2 - m2) - 4.0 * c * (d3 + m3),
                a - 3.0 * b * d + 6.0 * c * d2,
                b - 4.0 * c * d,
                c,
            ]
        )
