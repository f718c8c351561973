"""Whether an emulator is calibrated: predictions of the strings of a campaign without each."""

import math
from typing import TYPE_CHECKING, Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from agglom_mpi.formatting import format_digits
from agglom_mpi.inference.criteria import Band, NearMaximum

if TYPE_CHECKING:
    from agglom_mpi.inference.feasible_set import FeasibleSet

Floats = NDArray[np.float64]

JUDGED: Final = 100
"""Strings that it is judged by, at least: the likeliest members, and others by their distance."""
INTERVAL: Final = 1.6448536
"""Half-width of a 90 % interval in standard deviations."""
LEAST_COVERAGE: Final = 0.80
"""Minimum coverage of the 90 % intervals of a calibrated emulator."""
MOST_COVERAGE: Final = 0.97
"""Coverage above which they are wider than the errors of the emulator: what it predicts is known
better than it claims, and a set by it is only less sharp than it might be."""
BINS: Final = 10
"""Bins of the reliability."""


class Region(NamedTuple):
    """Held-out predictions in a region: number, coverage of 90 % intervals, rms z-score."""

    name: str
    strings: int
    coverage: float
    rms: float


class Reliability(NamedTuple):
    """Strings of one bin of the predicted probability: its mean, the true share, the number."""

    predicted: float
    observed: float
    strings: int


class Calibration(NamedTuple):
    """How well held-out strings are predicted.

    Attributes
    ----------
    regions
        The first is what the emulator is judged by: strings near the set.
    reliability
        Of the probability that the mean of a held-out string is beyond `threshold`.
    threshold
        Middle of the band, or the bound of the set.
    width
        Median half-width of the 90 % intervals near the set, relative to half of the band; nan
        where several numbers are compared, or the set has one bound.
    """

    regions: list[Region]
    reliability: list[Reliability]
    threshold: float
    width: float = math.nan

    @property
    def passed(self) -> bool:
        """Whether the emulator is calibrated near the set: its intervals are not too narrow."""
        return self.regions[0].coverage >= LEAST_COVERAGE

    @property
    def too_wide(self) -> bool:
        """Whether its intervals near the set are wider than its errors."""
        return self.regions[0].coverage > MOST_COVERAGE

    @property
    def text(self) -> str:
        """One-line verdict, without a full stop."""
        near = self.regions[0]
        held = (
            f"its 90 % intervals hold {format_digits(100 * near.coverage, 3)} % of the "
            f"{near.strings} held-out strings near the set"
        )
        if not self.passed:
            needed = f"at least {100 * LEAST_COVERAGE:.0f} % is needed"
            return f"the emulator is not calibrated: {held}, {needed}"
        if not self.too_wide:
            allowed = f"allowed {100 * LEAST_COVERAGE:.0f} to {100 * MOST_COVERAGE:.0f} %"
            return f"the emulator is calibrated: {held}, {allowed}"
        width = "" if math.isnan(self.width) else f", half-width {self.width:.2g} of the tolerance"
        return f"the emulator knows more than it claims: {held}{width}"

    def as_dict(self) -> dict[str, Any]:
        """Return it as plain values."""
        return {
            "calibrated": self.passed,
            "too_wide": self.too_wide,
            "width": None if math.isnan(self.width) else self.width,
            "regions": [region._asdict() for region in self.regions],
            "threshold": self.threshold,
            "reliability": [each._asdict() for each in self.reliability],
        }


def calibrate(of: "FeasibleSet") -> Calibration:
    """Return how well the emulator of a set predicts each string without it."""
    predicted = of.emulator.held_out
    scores = np.array([(means - m) / d for means, m, d in predicted])
    means, expected, deviation = predicted[0]
    lower, upper = _bounds(of)
    outside = np.maximum(np.maximum(lower - expected, expected - upper), 0.0) / deviation
    near = outside <= max(1.0, float(np.sort(outside)[min(JUDGED, len(outside)) - 1]))
    regions = [_region("near the set", scores[:, near])]
    for name, which in (("below it", expected < lower), ("above it", expected > upper)):
        if np.any(which & ~near):
            regions.append(_region(name, scores[:, which & ~near]))
    threshold = (
        0.5 * (lower + upper)
        if np.isfinite(lower) and np.isfinite(upper)
        else (upper if np.isfinite(upper) else lower)
    )
    # The noise of samples is skewed, so its distribution is that of the scores near the set.
    known = np.sort(scores[0, near])
    below = np.searchsorted(known, (threshold - expected) / deviation) / len(known)
    beyond = 1.0 - below
    reliability = _reliability(beyond, means > threshold)
    width = INTERVAL * float(np.median(deviation[near])) / _half_band(of)
    return Calibration(regions, reliability, float(threshold), width)


def _half_band(of: "FeasibleSet") -> float:
    """Return half of the range of what is compared in the set; nan if that has no scale."""
    if not isinstance(of.criterion, Band):
        return math.nan
    if isinstance(of.criterion, NearMaximum):
        return (1.0 - of.criterion.share) * of.maximum[0]
    half = 0.5 * (of.criterion.upper - of.criterion.lower)
    return half if math.isfinite(half) else math.nan


def _bounds(of: "FeasibleSet") -> tuple[float, float]:
    """Return the bounds of the first emulated number in the set, or its range there."""
    if isinstance(of.criterion, Band):
        return of.bounds
    points = of.points
    likely = points.probability >= 0.5 * points.probability.max()
    values = of.emulator.first_mean(of.coordinates.of_strings(points.strings[likely]))
    return float(values.min()), float(values.max())


def _region(name: str, scores: Floats) -> Region:
    coverage = float(np.mean(np.abs(scores) < INTERVAL))
    return Region(name, scores.shape[1], coverage, float(np.sqrt(np.mean(scores**2))))


def _reliability(predicted: Floats, happened: NDArray[np.bool_]) -> list[Reliability]:
    bins = np.minimum((predicted * BINS).astype(np.int64), BINS - 1)
    return [
        Reliability(float(predicted[bins == i].mean()), float(happened[bins == i].mean()), int(n))
        for i, n in enumerate(np.bincount(bins, minlength=BINS).tolist())
        if n
    ]
