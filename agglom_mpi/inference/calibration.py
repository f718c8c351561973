"""Whether an emulator is calibrated: predictions of the strings of a campaign without each."""

import math
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from agglom_mpi.formatting import format_digits
from agglom_mpi.inference.emulated_set import EmulatedSet
from agglom_mpi.inference.set_points import SetPoints
from agglom_mpi.statistics import Floats

MIN_HELD_OUT: Final = 100
"""Minimum number of held-out strings near the set, those nearest to it where it has fewer."""
HALF_INTERVAL: Final = 1.6448536
"""Half-width of a 90 % interval in standard deviations."""
MIN_COVERAGE: Final = 0.80
"""Minimum coverage of the 90 % intervals of a calibrated emulator."""
MAX_COVERAGE: Final = 0.97
"""Coverage above which the 90 % intervals are wider than the errors of the emulator.

The set is then only less sharp than it might be.
"""
RELIABILITY_BINS: Final = 10
"""Number of bins of the predicted probability."""
LIKELY_SHARE: Final = 0.5
"""Minimum probability, relative to the largest one, of the points that show the range of a set."""


class Region(NamedTuple):
    """Held-out predictions in a region: their number, coverage of 90 % intervals, rms z-score."""

    name: str
    strings: int
    coverage: float
    rms: float


class Reliability(NamedTuple):
    """One bin of the predicted probability: its mean, the observed share, number of strings."""

    predicted: float
    observed: float
    strings: int


class Calibration(NamedTuple):
    """Accuracy of the predictions of held-out strings.

    Attributes
    ----------
    regions
        Strings near the set, which decide whether the emulator is calibrated, and other regions.
    reliability
        Reliability of the probability that the mean of a held-out string is beyond `threshold`.
    threshold
        Middle of the band, or the bound of a set with one bound.
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
        return self.regions[0].coverage >= MIN_COVERAGE

    @property
    def too_wide(self) -> bool:
        """Whether its intervals near the set are wider than its errors."""
        return self.regions[0].coverage > MAX_COVERAGE

    @property
    def text(self) -> str:
        """One-line verdict, without a full stop."""
        near = self.regions[0]
        held = (
            f"its 90 % intervals hold {format_digits(100 * near.coverage, 3)} % of the "
            f"{near.strings} held-out strings near the set"
        )
        if not self.passed:
            needed = f"at least {100 * MIN_COVERAGE:.0f} % is needed"
            return f"the emulator is not calibrated: {held}, {needed}"
        if not self.too_wide:
            allowed = f"allowed {100 * MIN_COVERAGE:.0f} to {100 * MAX_COVERAGE:.0f} %"
            return f"the emulator is calibrated: {held}, {allowed}"
        width = "" if math.isnan(self.width) else f", half-width {self.width:.2g} of the tolerance"
        return f"the emulator knows more than it claims: {held}{width}"

    def as_dict(self) -> dict[str, Any]:
        """Return the calibration as plain values."""
        return {
            "calibrated": self.passed,
            "too_wide": self.too_wide,
            "width": None if math.isnan(self.width) else self.width,
            "regions": [region._asdict() for region in self.regions],
            "threshold": self.threshold,
            "reliability": [each._asdict() for each in self.reliability],
        }


def calibrate(emulated: EmulatedSet, points: SetPoints) -> Calibration:
    """Return how well the emulator predicts each string from all the others."""
    predicted = emulated.emulator.held_out
    scores = np.array([(means - m) / d for means, m, d in predicted])
    means, expected, deviation = predicted[0]
    lower, upper = _bounds(emulated, points)
    outside = np.maximum(np.maximum(lower - expected, expected - upper), 0.0) / deviation
    nearest = np.sort(outside)[min(MIN_HELD_OUT, len(outside)) - 1]
    near = outside <= max(1.0, float(nearest))
    regions = [region_of("near the set", scores[:, near])]
    for name, which in (("below it", expected < lower), ("above it", expected > upper)):
        if np.any(which & ~near):
            regions.append(region_of(name, scores[:, which & ~near]))
    threshold = float(np.mean([end for end in (lower, upper) if np.isfinite(end)]))
    # The noise of samples is skewed, so its distribution is that of the scores near the set.
    known = np.sort(scores[0, near])
    below = np.searchsorted(known, (threshold - expected) / deviation) / len(known)
    reliability = _reliability(1.0 - below, means > threshold)
    width = HALF_INTERVAL * float(np.median(deviation[near])) / emulated.criterion.half_width
    return Calibration(regions, reliability, threshold, width)


def _bounds(emulated: EmulatedSet, points: SetPoints) -> tuple[float, float]:
    """Return the bounds of the first emulated number in the set, or its range there."""
    if emulated.criterion.is_band:
        return emulated.criterion.bounds()
    likely = points.probability >= LIKELY_SHARE * points.probability.max()
    at = emulated.coordinates.of_strings(points.strings[likely])
    values = emulated.emulator.processes[0].mean(at)
    return float(values.min()), float(values.max())


def region_of(name: str, scores: Floats) -> Region:
    """Return what scores of held-out strings, (numbers, n) standard deviations, say of a region."""
    coverage = float(np.mean(np.abs(scores) < HALF_INTERVAL))
    return Region(name, scores.shape[1], coverage, float(np.sqrt(np.mean(scores**2))))


def _reliability(predicted: Floats, happened: NDArray[np.bool_]) -> list[Reliability]:
    bins = np.minimum((predicted * RELIABILITY_BINS).astype(np.int64), RELIABILITY_BINS - 1)
    return [
        Reliability(float(predicted[bins == i].mean()), float(happened[bins == i].mean()), int(n))
        for i, n in enumerate(np.bincount(bins, minlength=RELIABILITY_BINS).tolist())
        if n
    ]
