"""Misfit of a string: how far its predictions are from the data, in units of the errors of both.

The residuals are compared by χ² = rᵀ C⁻¹ r, where C is the covariance of the measurement plus that
of the samples. The latter is the covariance of the jackknife, over all data together, as data of
the same samples correlate. Few samples do not determine it: its correlations are shrunk towards 0
by the fraction that minimises the expected error (Schäfer and Strimmer, Stat. Appl. Genet. Mol.
Biol. 4, 2005, 32, with variances of normal samples).

Shares of classes sum to 1, so their residuals lie in a subspace. All is calculated there, after the
covariance has been projected on it, and no class is left out. To drop any one class of the
projected covariance gives the same χ².
"""

import math
from collections.abc import Sequence
from functools import lru_cache
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from agglom_mpi.measurements.census import Censuses, sample_count
from agglom_mpi.measurements.datum import Datum, exact_values, predictions
from agglom_mpi.statistics import Floats

UNLIKELY: Final = 0.05
"""Probability of a larger χ² below which data and predictions disagree."""
MIN_RELATIVE_VARIANCE: Final = 1e-10
"""Variance of a direction relative to the largest of its datum below which it has no error."""


class DatumMisfit(NamedTuple):
    """Comparison of a string with one datum.

    Attributes
    ----------
    datum
        The datum.
    residual, error
        Prediction minus measurement, and the standard error of this difference, shape (q,) each.
    share
        Part of the χ² of all data that is due to this datum. The parts sum to 1; that of a datum
        may be negative, where others explain its residual.
    chi_square, rank, p_value
        Of this datum alone.
    """

    datum: Datum
    residual: Floats
    error: Floats
    share: float
    chi_square: float
    rank: int
    p_value: float

    @property
    def name(self) -> str:
        """Name of the datum."""
        return self.datum.name


class Misfit(NamedTuple):
    """Comparison of a string with data.

    Attributes
    ----------
    value
        (χ² − tr(C⁻¹S))/rank, with the covariance S of the samples: what their noise adds to χ² is
        subtracted. About 1 where only the errors of the measurement are left; it may be negative.
        It is inf without samples, or where they have no finite prediction.
    standard_error
        Of the value, by the noise of the samples alone; nan below two samples.
    chi_square, rank
        χ² = rᵀ C⁻¹ r by the errors of measurement and samples, and its number of directions.
    p_value
        Probability of a larger χ² if the string were right; nan below two samples.
    parts
        One for each datum.
    """

    value: float
    standard_error: float
    chi_square: float
    rank: int
    p_value: float
    parts: tuple[DatumMisfit, ...]


def misfit(census: Censuses, data: Sequence[Datum]) -> Misfit:
    """Return how far a string is from data.

    Parameters
    ----------
    census
        The samples of the string, as `predictions` takes them.
    data
        At least one datum.
    """
    frame = residual_frame(tuple(data))
    if sample_count(census) == 0:
        return frame.nothing()
    predicted = predictions(census, data)
    if not np.all(np.isfinite(predicted.pooled)):
        return frame.nothing()
    noise = sampling_noise(predicted.left_out, exact_values(data))
    return frame.compare(predicted.pooled, noise)


class SamplingNoise(NamedTuple):
    """Covariance of predictions by the scatter of the samples.

    Attributes
    ----------
    raw, shrunk
        The covariance of the jackknife, and the same with smaller correlations, shape (Q, Q); 0
        with a single sample.
    intensity
        Fraction λ by which the correlations are smaller, from 0 to 1.
    freedom
        Degrees of freedom, the number of samples less 1; 0 where the noise is not known.
    deviations
        Of each sample from the mean, shape (n, Q): the pseudo-values of the jackknife.
    """

    raw: Floats
    shrunk: Floats
    intensity: float
    freedom: int
    deviations: Floats

    def of(self, rows: slice) -> "SamplingNoise":
        """Return the noise of some of the predictions."""
        return self._replace(
            raw=self.raw[rows, rows],
            shrunk=self.shrunk[rows, rows],
            deviations=self.deviations[:, rows],
        )


def sampling_noise(left_out: Floats, exact: NDArray[np.bool_] | None = None) -> SamplingNoise:
    """Return the covariance of predictions from those without one sample each, shape (n, Q).

    Predictions that do not rest on samples, `exact`, (Q,), have no noise.

    With the correlations r of the jackknife, λ = Σ var(r)/Σ r² over all pairs; var(r) is that of
    the covariance of two normal numbers in units of their deviations, (1 + r²)/(n − 1). The noise
    is not known from one sample, or where a prediction fails without one of them.
    """
    n, size = left_out.shape
    zero = np.zeros((size, size))
    if exact is not None and exact.all():  # nothing is to be estimated
        return SamplingNoise(zero, zero, 1.0, max(n - 1, 1), np.zeros((max(n, 2), size)))
    if n < 2 or not np.all(np.isfinite(left_out)):
        return SamplingNoise(zero, zero, 1.0, 0, np.zeros((n, size)))
    deviations = (n - 1) * (np.mean(left_out, axis=0) - left_out)
    if exact is not None:
        deviations[:, exact] = 0.0
    raw = deviations.T @ deviations / (n * (n - 1))
    errors = np.sqrt(np.diag(raw))
    scale = np.where(errors > 0.0, errors, 1.0)
    correlations = raw / np.outer(scale, scale)
    noisy = int(np.count_nonzero(errors))
    squares = float(np.sum(correlations**2)) - noisy
    variances = (noisy * (noisy - 1) + squares) / (n - 1)
    intensity = min(1.0, variances / squares) if squares > 0.0 else 1.0
    shrunk = (1.0 - intensity) * raw + intensity * np.diag(np.diag(raw))
    return SamplingNoise(raw, shrunk, intensity, n - 1, deviations)


class ResidualFrame:
    """The data in the subspace in which residuals lie and the measurement has errors.

    Each datum has its own directions, over its errors along them; roots of the correlations of
    these errors make a basis of them, (Q, p), in which all errors are independent.

    Attributes
    ----------
    data
        The data, in their order.
    measured
        All measured values, one datum after the other, shape (Q,).
    rows, columns
        Places of each datum among the values and among the columns of the basis.
    basis
        Shape (Q, p). Errors of the measurement along its columns are independent and of variance 1.
    roots
        Cholesky factor of the correlations between the data's own directions, shape (p, p): its
        rows of a datum take components in the basis to those of the datum alone.
    covariance
        Of the errors of the measurement, shape (Q, Q).
    rank
        Number of directions p.
    """

    def __init__(self, data: Sequence[Datum]) -> None:
        # Imported here: a report without data needs no linear algebra.
        from scipy.linalg import block_diag

        self.data = data
        self.measured = np.concatenate([datum.values for datum in data])
        bases = [_basis(datum) for datum in data]
        self.rows = _slices([len(datum.values) for datum in data])
        self.columns = _slices([basis.shape[1] for basis in bases])
        own = np.asarray(block_diag(*bases))
        self.covariance = np.asarray(block_diag(*(datum.covariance for datum in data)))
        self.roots = np.eye(own.shape[1])
        if self._correlate():
            self.roots = np.linalg.cholesky(own.T @ self.covariance @ own)
            own = own @ np.linalg.inv(self.roots).T
        self.basis = own
        self.rank = self.basis.shape[1]

    def _correlate(self) -> bool:
        """Add what the errors of different data have in common; return whether some have."""
        places = {datum: rows.start for datum, rows in zip(self.data, self.rows, strict=True)}
        errors = np.sqrt(np.diag(self.covariance))
        pairs = [
            (i, places[other], value)
            for datum, i in places.items()
            for other, value in datum.correlations
            if other in places
        ]
        for i, j, value in pairs:
            self.covariance[i, j] = self.covariance[j, i] = value * errors[i] * errors[j]
        return bool(pairs)

    def nothing(self) -> Misfit:
        """Return the misfit of a string that predicts nothing."""
        parts = tuple(
            DatumMisfit(
                datum,
                np.full(len(datum.values), math.nan),
                np.full(len(datum.values), math.nan),
                math.nan,
                math.inf,
                columns.stop - columns.start,
                math.nan,
            )
            for datum, columns in zip(self.data, self.columns, strict=True)
        )
        return Misfit(math.inf, math.nan, math.inf, self.rank, math.nan, parts)

    def compare(self, predicted: Floats, noise: SamplingNoise) -> Misfit:
        """Return the misfit of predictions, (Q,), with their noise."""
        residuals = predicted - self.measured
        total = self.covariance + noise.shrunk
        inverse = np.linalg.inv(self.basis.T @ total @ self.basis)
        weights = self.basis @ inverse @ self.basis.T
        chi_square = float(residuals @ weights @ residuals)
        return Misfit(
            (chi_square - float(np.sum(weights * noise.raw))) / self.rank,
            value_error(residuals, weights, noise, self.rank),
            chi_square,
            self.rank,
            _probability(chi_square, self.rank, weight_variance(weights, noise), noise),
            self._parts(residuals, total, weights @ residuals, noise),
        )

    def _parts(
        self, residuals: Floats, total: Floats, pulls: Floats, noise: SamplingNoise
    ) -> tuple[DatumMisfit, ...]:
        """Return the comparison with each datum; `pulls` is C⁻¹ r, and `total` is C."""
        products = residuals * pulls
        chi_square = float(np.sum(products))
        errors = np.sqrt(np.diag(total))
        parts = []
        for datum, rows, columns in zip(self.data, self.rows, self.columns, strict=True):
            share = float(np.sum(products[rows])) / chi_square if chi_square > 0.0 else math.nan
            alone = _alone(
                residuals[rows], total[rows, rows], self.basis[rows, columns], noise.of(rows)
            )
            parts.append(DatumMisfit(datum, residuals[rows], errors[rows], share, *alone))
        return tuple(parts)


def _alone(
    residuals: Floats, total: Floats, basis: Floats, noise: SamplingNoise
) -> tuple[float, int, float]:
    """Return χ², its rank and its p-value by the rows of one datum."""
    if len(residuals) == 1:  # what follows, in numbers: most data have one value
        weight = 1.0 / float(total[0, 0])
        chi_square = weight * float(residuals[0]) ** 2
        variance = 2.0 * (weight * float(noise.raw[0, 0])) ** 2 / max(noise.freedom, 1)
    else:
        weights = basis @ np.linalg.inv(basis.T @ total @ basis) @ basis.T
        chi_square = float(residuals @ weights @ residuals)
        variance = weight_variance(weights, noise)
    rank = basis.shape[1]
    return chi_square, rank, _probability(chi_square, rank, variance, noise)


def _probability(chi_square: float, rank: int, variance: float, noise: SamplingNoise) -> float:
    return tail_probability(chi_square, rank, variance) if noise.freedom else math.nan


@lru_cache(maxsize=16)
def residual_frame(data: tuple[Datum, ...]) -> ResidualFrame:
    """Return the frame of data, once for all strings; data are told apart by identity."""
    return ResidualFrame(data)


def _basis(datum: Datum) -> Floats:
    """Return the directions of a datum that are compared, over its error, shape (q, p)."""
    covariance = datum.covariance
    if datum.kind.is_curve:
        size = len(covariance)
        centring = np.eye(size) - 1.0 / size
        covariance = centring @ covariance @ centring
    variances, directions = np.linalg.eigh(covariance)
    kept = variances > MIN_RELATIVE_VARIANCE * variances[-1]
    return np.asarray(directions[:, kept] / np.sqrt(variances[kept]))


def _slices(sizes: Sequence[int]) -> list[slice]:
    ends = np.cumsum(sizes).tolist()
    return [slice(end - size, end) for end, size in zip(ends, sizes, strict=True)]


def weight_variance(weights: Floats, noise: SamplingNoise) -> float:
    """Return E tr(W Δ W Δ), where Δ is the error of the shrunk covariance of the samples.

    With n − 1 degrees of freedom the error of a covariance S has the covariance
    (S_ik S_jl + S_il S_jk)/(n − 1); shrinking multiplies it by 1 − λ off the diagonal. W is the
    inverse of the whole covariance, (Q, Q).
    """
    if noise.freedom == 0:
        return math.nan
    kept, shrunk = 1.0 - noise.intensity, noise.intensity
    product = weights @ noise.shrunk
    traces = float(np.trace(product)) ** 2 + float(np.sum(product * product.T))
    diagonal = float(np.sum(np.diag(product) ** 2))
    squares = float(np.sum((weights * noise.shrunk) ** 2))
    whole = kept**2 * traces + 4.0 * kept * shrunk * diagonal + 2.0 * shrunk**2 * squares
    return whole / noise.freedom


def value_error(residuals: Floats, weights: Floats, noise: SamplingNoise, rank: int) -> float:
    """Return the standard error of the value of a misfit by the jackknife; nan below two samples.

    A sample that deviates by u moves r by u/n, and so rᵀWr by 2 rᵀWu/n. It also moves the
    covariance in W by uuᵀ/n², less its shrunk correlations, and so rᵀWr by −(rᵀWu)²/n². Both are
    taken together, as the deviations of skewed numbers correlate with their squares.

    The noise of r itself adds 4 tr(WSWS) to the mean square of the first term, which is removed,
    and 2 tr(WSWS) to the variance of rᵀWr.
    """
    if noise.freedom == 0:
        return math.nan
    n = noise.freedom + 1
    terms = noise.deviations * (weights @ residuals)
    along = np.sum(terms, axis=1)
    squared = (1.0 - noise.intensity) * along**2 + noise.intensity * np.sum(terms**2, axis=1)
    variance = float(np.var(2.0 * along - squared / n, ddof=1)) / n
    product = weights @ noise.shrunk
    squares = float(np.sum(product * product.T))
    return math.sqrt(max(variance - 4.0 * squares, 0.0) + 2.0 * squares) / rank


def tail_probability(chi_square: float, rank: int, variance: float) -> float:
    """Return the probability of a larger χ² where the samples' covariance is estimated.

    χ² is taken for Hotelling's T² with the degrees of freedom f = (p + p²)/variance: those of a
    covariance that is estimated as well as the sum of a known and an estimated one (Nel and van
    der Merwe 1986; Krishnamoorthy and Yu, Stat. Probab. Lett. 66, 2004, 161).

    Parameters
    ----------
    chi_square, rank
        χ² and its number of directions p.
    variance
        From `weight_variance`.
    """
    from scipy.special import chdtrc, fdtrc

    if not variance > 0.0:
        return float(chdtrc(rank, chi_square))
    freedom = (rank + rank**2) / variance
    rest = max(freedom - rank + 1.0, 1.0)
    return float(fdtrc(rank, rest, chi_square * rest / (freedom * rank)))
