"""What to measure next: how much of the box is left after each measurement that could be made.

It needs no new samples. Those of the file predict every quantity of one number at every time at
which the campaign takes censuses, and the measured data as they would be with half of their error.
"""

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Final, NamedTuple

import numpy as np

from agglom_mpi.config.searchable import allowed_share
from agglom_mpi.emulation.blas_threads import single_threaded
from agglom_mpi.errors import require_library
from agglom_mpi.formatting import ROUNDING, value_with_error
from agglom_mpi.inference.candidate_data import (
    REPEATED_ERROR,
    assumed_error,
    new_data,
    read_errors,
    repeated,
)
from agglom_mpi.inference.data_emulator import EmulatedData
from agglom_mpi.inference.expected_volume import (
    Candidate,
    DataAtPoints,
    LinearQuantity,
    WeightedPoints,
    emulated_candidate,
    expected_volume,
)
from agglom_mpi.inference.posterior_sampling import BoxPart, WeightedStrings
from agglom_mpi.inference.searched_box import SearchedBox
from agglom_mpi.inference.stored_samples import string_values
from agglom_mpi.measurements.datum import Datum
from agglom_mpi.measurements.quantities import AssumedError
from agglom_mpi.random_streams import NEXT_MEASUREMENT, search_stream
from agglom_mpi.statistics import Floats, MeanEstimate, weighted_quantiles

if TYPE_CHECKING:
    import pandas as pd

    from agglom_mpi.storage.reader import CampaignData

REGION_POINTS: Final = 2000
"""Number of points that are wanted in the region with 90 % of the posterior."""
MIN_POINTS, MAX_POINTS = 1 << 12, 1 << 15
"""Minimum and maximum number of even points in the part of the box that has the posterior."""
PART_MARGIN: Final = 0.05
"""Margin added to the part of the box that has the posterior, relative to its edges."""
MIN_MARGIN: Final = 1e-3
"""Minimum margin in units of the box."""
MIN_RELATIVE_WEIGHT: Final = 1e-6
"""Weight relative to the largest one below which a point is left out."""
MIN_RESOLVED_POINTS: Final = 30.0
"""Mean number of points in the region below which a volume is an upper bound."""

EMULATOR_STREAM, MEASUREMENT_STREAM = range(2)
"""Random streams, each the same for all candidates: what is drawn does not depend on their order.
"""


@dataclass(frozen=True)
class Measurable:
    """A measurement that could be made.

    Attributes
    ----------
    datum
        The quantity, its weight and its time.
    repeats
        Whether it is a repetition of one of the data with half of its error.
    error
        Its error as it is assumed; None of a repetition.
    predicted
        Median by the posterior in SI units; nan of shares of sizes.
    standard_error
        Standard error of the measurement in SI units; nan of shares of sizes.
    """

    datum: Datum
    repeats: bool
    error: AssumedError | None
    predicted: float
    standard_error: float

    @property
    def name(self) -> str:
        """Name of the measurement for people."""
        return self.datum.name

    @property
    def error_text(self) -> str:
        """Its error for people: `± 5 %`, or `half of its error`."""
        if self.error is None:
            return "half of its error"
        return "± " + self.error.text(self.datum.kind.unit)

    def record(self) -> dict[str, Any]:
        """Return what it is as plain values."""
        return {
            "measurement": self.name,
            **({"experiment": self.datum.experiment} if self.datum.experiment else {}),
            "quantity": self.datum.quantity,
            "weight": self.datum.own_weight or "",
            "time": math.inf if self.datum.time is None else self.datum.time,
            "repeats": self.repeats,
            "predicted": self.predicted,
            "error": self.standard_error,
            "unit": self.datum.kind.unit,
        }


@dataclass(frozen=True)
class NextMeasurement(Measurable):
    """A measurement that could be made, and what it would leave of the box.

    Attributes
    ----------
    after
        Expected volume of the posterior after it, as a share of the box.
    resolved
        Whether the points are dense enough for this volume; otherwise it is an upper bound.
    """

    after: MeanEstimate
    resolved: bool

    @property
    def volume_text(self) -> str:
        """Expected volume in percent with its Monte-Carlo error."""
        shown = value_with_error(100.0 * self.after.value, 100.0 * self.after.error)
        return f"{'' if self.resolved else 'at most '}{shown} %"


class NextMeasurements(NamedTuple):
    """Measurements that could be made, the one that leaves the smallest volume first.

    Attributes
    ----------
    volume
        Of the posterior as it is: share of the box in the smallest region with 90 % of it.
    ranked
        The measurements.
    """

    volume: float
    ranked: tuple[NextMeasurement, ...]

    @property
    def table(self) -> "pd.DataFrame":
        """One row for each measurement, ranked; `unit` is that of `predicted` and `error`.

        `time` is in s, inf at the end; `volume` and `expected_volume` are shares of the box, and
        `standard_error` is the Monte-Carlo error of the latter.
        """
        require_library("pandas", "report", "tables")
        import pandas as pd

        frame = pd.DataFrame(self.records())
        shares = ("volume", "expected_volume", "standard_error")
        frame.attrs["units"] = {"time": "s", **dict.fromkeys(shares, "1")}
        return frame

    def records(self) -> list[dict[str, Any]]:
        """Return the rows of the table as plain values."""
        return [
            each.record()
            | {
                "volume": self.volume,
                "expected_volume": each.after.value,
                "standard_error": each.after.error,
                "resolved": each.resolved,
            }
            for each in self.ranked
        ]


@single_threaded
def next_measurements(
    file: "CampaignData",
    of: EmulatedData,
    drawn: WeightedStrings,
    errors: Mapping[str, Any] | None = None,
) -> NextMeasurements:
    """Return the measurements that could be made next, ranked by the expected volume after them.

    Parameters
    ----------
    file
        The campaign file with the samples.
    of
        Emulator of the data that there are.
    drawn
        The posterior of these data.
    errors
        Errors of some quantities; see `read_errors`.

    Raises
    ------
    ArgumentError
        If an error is impossible.
    """
    try:
        stated = read_errors(errors)
    except ValueError as problem:
        raise of.box.mistaken("errors", problem) from None
    strings, points = dense_points(of, drawn)
    found = []
    for each, candidate in measurables(file, of, strings, points, stated):
        if each.repeats or candidate.covariances.any():
            after = expected_volume(points, candidate, _stream(of.box, MEASUREMENT_STREAM))
            resolved = after.value >= MIN_RESOLVED_POINTS * points.share
            found.append(NextMeasurement(**vars(each), after=after, resolved=resolved))
    ranked = sorted(found, key=lambda each: (each.after.value, each.name))
    return NextMeasurements(points.volume, tuple(ranked))


def measurables(
    file: "CampaignData",
    of: EmulatedData,
    strings: Floats,
    points: WeightedPoints,
    stated: Mapping[str, AssumedError],
) -> Iterator[tuple[Measurable, Candidate]]:
    """Yield what could be measured, as it is predicted at points of the posterior of the data.

    First each datum again, then all new quantities; what no string changes has no covariance.
    """
    known = of.at(strings)
    identity = np.eye(len(of.measured))
    data = DataAtPoints(known.means, known.deviations, of.emulator.mixing, of.measured, identity)
    yield from _repetitions(of, data, strings)
    yield from _new_quantities(file, of, data, strings, points, stated)


def dense_points(of: EmulatedData, drawn: WeightedStrings) -> tuple[Floats, WeightedPoints]:
    """Return even points of the part of the box that has the posterior: strings and weights.

    The part is a box along the principal axes of the posterior: data determine groups of variables,
    and leave a region that is long and thin, and oblique.
    """
    box = of.box
    counted = drawn.weights > MIN_RELATIVE_WEIGHT * drawn.weights.max()
    places = box.space.to_unit(drawn.strings[counted])
    part = BoxPart.around(places, drawn.weights[counted], PART_MARGIN, MIN_MARGIN)
    allowed = allowed_share(box.campaign).value if box.campaign.relations.constraints else 1.0
    share = part.volume / allowed
    wanted = REGION_POINTS * share / drawn.volume if drawn.volume > 0.0 else MAX_POINTS
    count = 1 << math.ceil(math.log2(min(max(wanted, MIN_POINTS), MAX_POINTS)))
    strings = part.even_strings(box, count)
    logarithms = of.log_density(strings)
    weights = np.exp(logarithms - logarithms.max())
    some = weights > MIN_RELATIVE_WEIGHT
    kept = weights[some] / weights[some].sum()
    return strings[some], WeightedPoints(kept, share / count)


def _repetitions(
    of: EmulatedData, data: DataAtPoints, strings: Floats
) -> Iterator[tuple[Measurable, Candidate]]:
    """Yield a repetition of each datum with half of its error."""
    exact = of.exact_numbers(strings)
    for datum, columns in zip(of.data, of.frame.columns, strict=True):
        own = of.frame.roots[columns]
        matrix = own @ of.components @ of.emulator.mixing
        # Along its own directions the errors of the datum are independent and 1; those of the
        # repetition are independent of all others.
        error_of_numbers = REPEATED_ERROR**2 * np.eye(len(matrix))
        rest = exact @ own[:, of.exact_columns].T if datum.kind.is_exact else 0.0
        candidate = data.expected(LinearQuantity(matrix, rest), error_of_numbers)
        value = error = math.nan
        if len(datum.values) == 1:
            value = float(datum.values[0])
            error = REPEATED_ERROR * math.sqrt(float(datum.covariance[0, 0]))
        yield Measurable(repeated(datum), True, None, value, error), candidate


def _new_quantities(
    file: "CampaignData",
    of: EmulatedData,
    data: DataAtPoints,
    strings: Floats,
    points: WeightedPoints,
    stated: Mapping[str, AssumedError],
) -> Iterator[tuple[Measurable, Candidate]]:
    """Yield each quantity of one number that is not measured.

    There is none where all data are impacts, whose samples need not predict anything.
    """
    if not of.emulator.processes:
        return
    layout = file.sizes.census
    assert layout is not None
    new = new_data(of.box.campaign, layout, of.data)
    values = string_values(file, [*of.data, *new])
    size = len(of.frame.measured)
    samples, numbers = (
        _samples_of(of, values.strings, values.values[:, :size]),
        values.values[:, size:],
    )
    at, groups = of.coordinates.of_strings(strings), len(of.coordinates.groups)
    for datum, number in zip(new, numbers.T, strict=True):
        if np.ptp(number) <= ROUNDING * np.abs(number).max():
            same = np.full((len(strings), 1), number[0])
            candidate = Candidate(same, np.zeros((len(strings), 1, 1)), np.zeros((1, 1)))
        else:
            random = _stream(of.box, EMULATOR_STREAM)
            linear = emulated_candidate(samples, number, at, random, groups)
            candidate = data.expected(linear, np.zeros((1, 1)))
        means = datum.kind.within_limits(candidate.means, values.lengths)
        [value] = weighted_quantiles(means[:, 0], points.weights, (0.5,))
        assumed = assumed_error(datum.quantity, of.data, stated)
        error = assumed.at(value)
        candidate = candidate._replace(error=np.array([[error**2]]))
        yield Measurable(datum, False, assumed, value, error), candidate


def _samples_of(of: EmulatedData, strings: Floats, values: Floats) -> tuple[Floats, Floats, Floats]:
    """Return coordinates, mixed components and held-out residuals as `emulated_candidate` needs.

    Samples of strings that predict the data alone, and not all that may be measured, are left out.
    """
    coordinates = of.coordinates.of_strings(strings)
    numbers = of.numbers_of(values)
    mixed = np.asarray(np.linalg.solve(of.emulator.mixing, numbers.T).T, np.float64)
    residuals = np.column_stack([means - held for means, held, _ in of.emulator.held_out])
    all_points = np.unique(of.points, axis=0)
    place = {point.tobytes(): i for i, point in enumerate(all_points)}
    kept = [place[point.tobytes()] for point in np.unique(coordinates, axis=0)]
    return coordinates, mixed, residuals[kept]


def _stream(box: SearchedBox, purpose: int) -> np.random.Generator:
    return search_stream(box.campaign.seed, NEXT_MEASUREMENT, purpose)
