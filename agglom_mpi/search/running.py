"""Running statistics: one value or one group more in constant time, without cancellation."""

import math


class RunningMean:
    """Mean and standard error of the values so far (Welford)."""

    def __init__(self) -> None:
        self.count = 0
        self.mean = math.nan
        self._squares = 0.0

    def add(self, value: float) -> None:
        """Take one more value."""
        self.count += 1
        if self.count == 1:
            self.mean = value
            return
        step = value - self.mean
        self.mean += step / self.count
        self._squares += step * (value - self.mean)

    @property
    def standard_error(self) -> float:
        """Standard error of the mean, nan below two values."""
        if self.count < 2:
            return math.nan
        return math.sqrt(self._squares / (self.count - 1) / self.count)


class PooledMoments:
    """Central moments of all members of the groups so far, from the groups' own moments.

    The sums of powers about the common mean are combined pairwise by the exact shift formulas
    (Chan, Golub and LeVeque 1979; Pébay 2008), so no member is ever looked at again.
    """

    def __init__(self) -> None:
        self.count = 0
        self.mean = 0.0
        self._sums = (0.0, 0.0, 0.0)

    def add(self, count: int, mean: float, central: tuple[float, float, float]) -> None:
        """Take one more group: its size, mean and central moments 2, 3, 4."""
        a, b = self.count, count
        n = a + b
        shift = mean - self.mean
        a2, a3, a4 = self._sums
        b2, b3, b4 = (moment * b for moment in central)
        self._sums = (
            a2 + b2 + shift**2 * a * b / n,
            a3 + b3 + shift**3 * a * b * (a - b) / n**2 + 3 * shift * (a * b2 - b * a2) / n,
            a4
            + b4
            + shift**4 * a * b * (a * a - a * b + b * b) / n**3
            + 6 * shift**2 * (a * a * b2 + b * b * a2) / n**2
            + 4 * shift * (a * b3 - b * a3) / n,
        )
        self.count = n
        self.mean += shift * b / n

    @property
    def central(self) -> tuple[float, float, float]:
        """Central moments 2, 3, 4 of all members [A 24]; needs a member."""
        second, third, fourth = self._sums
        return second / self.count, third / self.count, fourth / self.count
