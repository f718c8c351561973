"""Emulator of what strings predict for all measured data, and the density of the data given it.

Predictions are scaled by the errors of the measurement, in the directions in which residuals lie
(`measurements.misfit.ResidualFrame`), and rotated to principal components over the strings. Each
component is then in standard errors of the measurement, independent of the others. Components that
differ between strings by less than a tenth of that are not emulated: the data cannot tell the
strings apart by them, and their variance counts as an error.

Coefficients of restitution follow from the laws of a string without samples. They are evaluated at
each string, and not emulated: their directions are the last ones of those that are left out.
"""

import math
from collections.abc import Iterator, Sequence
from contextlib import suppress
from functools import cached_property
from typing import Any, Final

import numpy as np

from agglom_mpi.config.coordinates import coordinates_of
from agglom_mpi.emulation.emulator import merge_samples
from agglom_mpi.inference.posterior_sampling import MAX_LOGARITHM_AWAY, Observed
from agglom_mpi.inference.searched_box import EmulatedBox, EmulatedStrings, SearchedBox
from agglom_mpi.inference.stored_samples import StoredSamples, StringValues
from agglom_mpi.measurements.datum import Datum, exact_values, experiments_of
from agglom_mpi.measurements.misfit import ResidualFrame, residual_frame
from agglom_mpi.physics.impact_tests import impact_coefficients
from agglom_mpi.random_streams import DATA_POSTERIOR
from agglom_mpi.statistics import Floats

MIN_COMPONENT_VARIANCE: Final = 0.01
"""Minimum variance between strings of an emulated component; that of the measurement is 1."""
MAX_DENSITIES_AT_ONCE: Final = 4096
"""Maximum number of strings whose covariances are factored together."""

COARSE_POINTS: Final = 1 << 11
"""Number of even points of the box that show how near to the data strings come."""

MAX_PLAIN_IMPACTS: Final = 20_000
"""Maximum number of impacts that plain Python solves; beyond it their law is compiled."""

CALIBRATION_STREAM, PREDICTIVE_STREAM = 3, 4
"""Further random streams of a posterior of data."""


class EmulatedData(EmulatedBox):
    """Measured data, and what any string of the search box predicts for them.

    Parameters
    ----------
    box
        The search box.
    data
        The measured data.
    values
        Predictions of the samples for these data.
    stored
        The samples, for the strings that failed.

    Attributes
    ----------
    data : tuple of Datum
    frame : ResidualFrame
        Directions in which data and predictions are compared, scaled by the errors.
    components : ndarray
        Directions of the kept components in the frame, orthonormal, shape (p, k).
    left_out : ndarray
        Directions that are not emulated, orthonormal, shape (p, p − k); x of them are exact.
    left_out_variance : ndarray
        Variance between strings along these, shape (p − k,); 0 where values are exact.
    exact_columns : ndarray
        Columns of the frame whose values are exact, shape (x,).
    centre : ndarray
        Mean prediction of all strings in the frame, shape (p,).
    samples : ndarray
        Kept components of each sample, shape (n, k).
    measured : ndarray
        Kept components of the data, shape (k,).
    left_out_measured : ndarray
        The other components of the data, shape (p − k,).
    reached : ndarray
        Least and largest mean prediction of a string for each value of the data, shape (2, Q).
    lengths : tuple of float
        Smallest and largest diameter of a particle in m.
    """

    def __init__(
        self, box: SearchedBox, data: Sequence[Datum], values: StringValues, stored: StoredSamples
    ) -> None:
        self.data = tuple(data)
        several = len(self.data) > 1
        self.given = f"all {len(self.data)} measured data" if several else "the measured datum"
        self.criterion_text = f"data: {', '.join(datum.name for datum in self.data)}"
        self.frame: ResidualFrame = residual_frame(self.data)
        points = coordinates_of(box.campaign).of_strings(values.strings)
        framed = values.values @ self.frame.basis
        is_exact = exact_values(self.data)
        self._typical = self.frame.measured if is_exact.all() else values.values.mean(axis=0)
        self.lengths = values.lengths
        self._impacts_solved = 0
        self._set_components(points, framed)
        self.reached = np.array([[-math.inf], [math.inf]]) * np.ones(len(is_exact))
        for i in np.flatnonzero(~is_exact):
            means = merge_samples(points, values.values[:, i]).means
            self.reached[:, i] = means.min(), means.max()
        self.samples = (framed - self.centre) @ self.components
        super().__init__(box, values.strings, self.samples, stored, DATA_POSTERIOR)
        self.measured = self.numbers_of(self.frame.measured)
        away = self.frame.measured @ self.frame.basis - self.centre
        self.left_out_measured = np.asarray(away @ self.left_out)

    def _set_components(self, points: Floats, framed: Floats) -> None:
        """Find the components of the strings' means, (n, p) samples in the frame."""
        pairs = list(zip(self.data, self.frame.columns, strict=True))
        exact = [np.arange(columns.stop)[columns] for d, columns in pairs if d.kind.is_exact]
        self.exact_columns = np.concatenate(exact) if exact else np.empty(0, np.int64)
        if not len(self.exact_columns):
            self._set_principal_components(points, framed)
            return
        whole = np.eye(framed.shape[1])
        emulated = np.delete(whole, self.exact_columns, axis=1)
        self.centre, self.left_out_variance = np.empty(0), np.empty(0)
        self.components = self.left_out = np.empty((0, 0))
        if emulated.size:
            self._set_principal_components(points, framed @ emulated)
        self.centre = emulated @ self.centre
        self.components = emulated @ self.components
        self.left_out = np.hstack([emulated @ self.left_out, whole[:, self.exact_columns]])
        self.left_out_variance = np.append(
            self.left_out_variance, np.zeros(len(self.exact_columns))
        )

    def _set_principal_components(self, points: Floats, framed: Floats) -> None:
        """Find the principal components of the strings' means, (n, p) samples in the frame."""
        _, which, count = np.unique(points, axis=0, return_inverse=True, return_counts=True)
        which = which.ravel()
        means = np.zeros((len(count), framed.shape[1]))
        np.add.at(means, which, framed)
        means /= count[:, None]
        self.centre = means.mean(axis=0)
        noise = framed - means[which]
        scatter = np.divide(1.0, count * (count - 1.0), out=np.zeros(len(count)), where=count > 1)
        of_means = (noise * scatter[which, None]).T @ noise / len(count)
        between = np.atleast_2d(np.cov(means.T, bias=True)) - of_means
        variances, directions = np.linalg.eigh(between)
        kept = variances > MIN_COMPONENT_VARIANCE
        kept[-1] = True
        self.components = directions[:, kept][:, ::-1]
        self.left_out = directions[:, ~kept]
        self.left_out_variance = np.maximum(variances[~kept], 0.0)

    # Data, components and values

    def exact_numbers(self, strings: Floats) -> Floats:
        """Return what needs no samples of strings, in the frame, (n, x); nan if a law refuses."""
        found = np.full((len(strings), len(self.exact_columns)), math.nan)
        rows = exact_values(self.data)
        basis = self.frame.basis[np.ix_(rows, self.exact_columns)]
        exact = [datum for datum in self.data if datum.impacts is not None]
        impacts: dict[str, Any] = {
            name: np.concatenate([d.impacts for d in exact if d.experiment == name])
            for name in experiments_of(exact)
        }
        self._impacts_solved += len(strings) * sum(map(len, impacts.values()))
        solve = impact_coefficients
        if self._impacts_solved > MAX_PLAIN_IMPACTS:
            from agglom_mpi.simulation.impact import solve_impacts as solve  # loads the compiler
        for i, string in enumerate(strings if impacts else ()):
            with suppress(ValueError, ArithmeticError):
                tests = [self.box.campaign.impact_tests_at(string, name) for name in impacts]
                own = [
                    test.coefficients(some, solve)
                    for test, some in zip(tests, impacts.values(), strict=True)
                ]
                found[i] = np.concatenate(own) @ basis
        return found

    def exact_squares(self, strings: Floats, columns: Any = slice(None)) -> Floats:
        """Return χ² of what needs no samples, (n,); inf of strings that a law refuses.

        `columns` are those of `exact_columns` that count.
        """
        measured = self.left_out_measured[len(self.left_out_measured) - len(self.exact_columns) :]
        away = (measured - self.exact_numbers(strings))[:, columns]
        return np.nan_to_num(np.sum(away**2, axis=1), nan=math.inf)

    def numbers_of(self, values: Floats) -> Floats:
        """Return the kept components of values of all data, (…, Q), shape (…, k)."""
        return np.asarray((values @ self.frame.basis - self.centre) @ self.components)

    def values_of(self, components: Floats, left_out: Floats) -> Floats:
        """Return values of all data, (…, Q), of kept components, (…, k), and others, (…, p − k)."""
        framed = components @ self.components.T + left_out @ self.left_out.T
        back = np.linalg.pinv(self.frame.basis)
        rest = self._typical - (self._typical @ self.frame.basis) @ back
        return np.asarray(rest + (framed + self.centre) @ back)

    # Strings

    def covariances(self, deviations: Floats) -> Floats:
        """Return the covariances of the emulated components of strings, (n, k, k).

        `deviations` are those of the mixed components, shape (n, k).
        """
        mixing = self.emulator.mixing
        return np.asarray(np.einsum("ki,ni,li->nkl", mixing, deviations**2, mixing, optimize=True))

    def factors(self, deviations: Floats) -> Floats:
        """Return Cholesky factors of the covariances of data given strings, (n, k, k).

        The covariance is that of the measurement, the identity, and that of the emulator.
        """
        own = self.covariances(deviations)
        return np.asarray(np.linalg.cholesky(own + np.eye(own.shape[1])))

    def log_density(self, strings: Floats) -> Floats:
        """Return the logarithm of the density of the data given strings, but for a constant, (n,).

        It has the probability that samples of a string do not fail as a factor.
        """
        found = [np.empty(0)]
        for i in range(0, len(strings), MAX_DENSITIES_AT_ONCE):
            some = strings[i : i + MAX_DENSITIES_AT_ONCE]
            known = self.at(some)
            factors = self.factors(known.deviations)
            logarithms = log_densities(self.away(known)[None], factors, known.failing)[0]
            found.append(logarithms - 0.5 * self.exact_squares(some))
        return np.concatenate(found)

    def away(self, known: EmulatedStrings) -> Floats:
        """Return the measured less the emulated components of strings, (n, k)."""
        return np.asarray(self.measured - known.means @ self.emulator.mixing.T)

    def framed_residuals(self, strings: Floats) -> tuple[Floats, Floats]:
        """Return data less predictions of strings in the frame, and the covariances of these.

        Shapes (n, p) and (n, p, p); components that are not emulated are included.
        """
        away, covariances = self.emulated_residuals(self.at(strings))
        away[:, self.exact_columns] -= self.exact_numbers(strings)
        return away, covariances

    def emulated_residuals(self, known: EmulatedStrings) -> tuple[Floats, Floats]:
        """Return `framed_residuals` without exact values, whose columns have no meaning."""
        own, away = self.covariances(known.deviations), self.away(known) @ self.components.T
        rest = (self.left_out * self.left_out_variance) @ self.left_out.T + np.eye(len(self.centre))
        covariances = np.einsum(
            "ak,nkl,bl->nab", self.components, own, self.components, optimize=True
        )
        return away + self.left_out @ self.left_out_measured, covariances + rest

    def near(self, strings: Floats) -> Floats:
        """Return those of strings, (n, k), that no component alone rules out."""
        best, deviation = self._nearest
        mixing = self.emulator.mixing
        largest = 1.0 + (mixing**2) @ deviation**2
        points, means = self.coordinates.of_strings(strings), np.empty((len(strings), 0))
        for i, process in enumerate(self.emulator.processes):
            # The mixing is lower triangular: component i needs the first i + 1 processes alone.
            means = np.column_stack((means, process.mean(points)))
            away = self.measured[i] - means @ mixing[i, : i + 1]
            kept = away**2 <= (best + 2.0 * MAX_LOGARITHM_AWAY) * largest[i]
            strings, points, means = strings[kept], points[kept], means[kept]
        return strings

    @cached_property
    def _nearest(self) -> tuple[float, Floats]:
        """χ² of the best of some even points, and the largest deviation of each number there."""
        strings = self.box.even_strings(COARSE_POINTS)
        known = self.at(strings)
        chi = chi_squares(self.away(known)[None], self.factors(known.deviations))[0]
        best = float((chi + self.exact_squares(strings)).min())
        return best, known.deviations.max(axis=0)

    # What a posterior asks of what was measured

    def entries(self) -> dict[str, Any]:
        """Return what was measured as plain values: nothing, as it stands with the predictions."""
        return {}

    def observed(self) -> Iterator[Observed]:
        """Yield the data for an ArviZ file."""
        for i, datum in enumerate(self.data):
            meaning: dict[str, Any] = {"long_name": datum.name, "units": datum.kind.unit}
            if datum.edges is not None:
                meaning["edges"] = datum.edges
            if datum.impacts is not None:
                meaning["speeds"] = datum.impacts[:, 0]
            name = f"datum_{i}_{datum.quantity}"
            yield Observed(name, f"value_of_{i}", datum.values, datum.standard_errors, meaning)

    def measurements(
        self, strings: Floats, random: np.random.Generator, given: bool
    ) -> list[Floats]:
        """Return one further measurement of each datum for strings, (n, k): a list of (n, q)."""
        components, left_out = self.drawn_components(strings, random, given)
        components = components + random.normal(size=components.shape)
        left_out = left_out + random.normal(size=left_out.shape)
        values = self.values_of(components, left_out)
        return [values[:, rows] for rows in self.frame.rows]

    def drawn_components(
        self, strings: Floats, random: np.random.Generator, given: bool
    ) -> tuple[Floats, Floats]:
        """Return components drawn at strings: emulated ones, (n, k), and those left out."""
        known = self.at(strings)
        mean = known.means @ self.emulator.mixing.T
        own = self.covariances(known.deviations)
        rest, spread = np.zeros(len(self.left_out_variance)), self.left_out_variance
        if given:
            one = np.eye(own.shape[1])
            gain = np.linalg.solve(own + one, own).transpose(0, 2, 1)
            mean = mean + np.einsum("nkl,nl->nk", gain, self.measured - mean)
            # V − V (V + 1)⁻¹ V = V (V + 1)⁻¹, as the measurement's covariance is 1.
            own = np.asarray(gain, np.float64)
            rest = spread / (1.0 + spread) * self.left_out_measured
            spread = spread / (1.0 + spread)
        variances, directions = np.linalg.eigh(own)
        scaled = np.sqrt(np.maximum(variances, 0.0)) * random.normal(size=variances.shape)
        left_out = rest + np.sqrt(spread) * random.normal(size=(len(strings), len(spread)))
        left_out[:, len(spread) - len(self.exact_columns) :] += self.exact_numbers(strings)
        return mean + np.einsum("nkl,nl->nk", directions, scaled), left_out


def log_densities(away: Floats, factors: Floats, failing: Floats) -> Floats:
    """Return logarithms of normal densities of R data given n strings, but for a constant, (R, n).

    Parameters
    ----------
    away
        Data less predictions, shape (R, n, k).
    factors
        Cholesky factors of their covariances, shape (n, k, k).
    failing
        Probability that samples of each string fail, shape (n,).
    """
    chi = chi_squares(away, factors)
    logarithms = np.log(np.diagonal(factors, axis1=1, axis2=2)).sum(axis=1)
    with np.errstate(divide="ignore"):
        return np.asarray(np.log(1.0 - failing) - logarithms - 0.5 * chi)


def chi_squares(away: Floats, factors: Floats) -> Floats:
    """Return χ² of residuals, (R, n, k), by the factors of their covariances, (n, k, k): (R, n)."""
    inverse = np.linalg.inv(factors)
    return np.asarray((np.einsum("nkl,rnl->rnk", inverse, away, optimize=True) ** 2).sum(axis=2))
