"""What parts of the data say: each experiment, and each datum.

Posteriors without an experiment, and of it alone, rest on the emulator of all data. What it says of
some of them is the marginal of its normal distribution, so that nothing is fitted anew.

A datum has its prediction by the posterior of all data, and its density given the others, which
leaving it out rests on. Data have a covariance: by the errors of the measurement, and as the error
of the emulator at a string is shared. With the precision Q of all data and their residuals r, the
density of a datum is normal with the precision Q_ii about the residual Q_ii⁻¹ (Q r)_i (Bürkner,
Gabry and Vehtari, Comput. Stat. 36, 2021, 1243).
"""

import math
from collections.abc import Sequence
from typing import Any, Final, NamedTuple, TypeAlias

import numpy as np

from agglom_mpi.emulation.blas_threads import single_threaded
from agglom_mpi.formatting import value_with_prefix
from agglom_mpi.inference.data_emulator import (
    PREDICTIVE_STREAM,
    EmulatedData,
    chi_squares,
    log_densities,
)
from agglom_mpi.inference.posterior_sampling import (
    MAX_LOGARITHM_AWAY,
    PRIOR_POINTS,
    REPORTED_QUANTILES,
    WeightedStrings,
    contraction_of,
    sample_posterior,
)
from agglom_mpi.measurements.datum import Datum, experiments_of
from agglom_mpi.measurements.misfit import UNLIKELY
from agglom_mpi.statistics import Floats

AT_ONCE: Final = 2048
"""Maximum number of strings whose covariances of all data are kept together."""
PREDICTIVE_DRAWS: Final = 2000
"""Number of strings whose predictions are drawn."""
STRINGS_AT_ONCE: Final = 512
"""Number of strings whose covariances are inverted together."""


class Contribution(NamedTuple):
    """Posterior of the data of some experiments, relative to the box.

    Attributes
    ----------
    label
        For people: `all`, `without slow`, `slow alone`.
    experiments
        Names of the experiments whose data are used.
    contraction
        Width of the central 90 % of each variable relative to the prior's, by name.
    volume
        Share of the box in the smallest region with 90 % of the posterior.
    effective_size
        Number of independent strings that would be as informative.
    """

    label: str
    experiments: tuple[str, ...]
    contraction: dict[str, float]
    volume: float
    effective_size: float

    def as_dict(self) -> dict[str, Any]:
        """Return the contribution as plain values."""
        return {**self._asdict(), "experiments": list(self.experiments)}


class DataOfSome:
    """The data of some experiments, by the emulator of the data of all.

    Parameters
    ----------
    whole
        Emulator of all data.
    experiments
        Names of the experiments whose data count.

    Attributes
    ----------
    box
        The search box.
    columns
        Columns of the frame that belong to these data and are emulated.
    """

    def __init__(self, whole: EmulatedData, experiments: tuple[str, ...]) -> None:
        self.box, self._whole = whole.box, whole
        every = np.arange(whole.frame.rank)
        own = zip(whole.data, whole.frame.columns, strict=True)
        columns = np.concatenate([every[c] for d, c in own if d.experiment in experiments])
        self.columns = columns[~np.isin(columns, whole.exact_columns)]
        self._exact = np.isin(whole.exact_columns, columns)

    def log_density(self, strings: Floats) -> Floats:
        """Return the logarithm of the density of the data given strings, (n, k): (n,).

        Exact values, which take longest, are evaluated where the others leave some weight.
        """
        found = [np.empty(0)]
        for i in range(0, len(strings), AT_ONCE):
            found.append(self._emulated(strings[i : i + AT_ONCE]))
        logarithms = np.concatenate(found)
        if self._exact.any():
            near = logarithms > logarithms.max(initial=-np.inf) - MAX_LOGARITHM_AWAY
            logarithms[~near] = -np.inf
            logarithms[near] -= 0.5 * self._whole.exact_squares(strings[near], self._exact)
        return logarithms

    def _emulated(self, strings: Floats) -> Floats:
        """Return the logarithm of the density of what is emulated, (n,)."""
        whole, columns = self._whole, self.columns
        known = whole.at(strings)
        away, covariances = whole.emulated_residuals(known)
        own = covariances[:, columns[:, None], columns]
        factors = np.asarray(np.linalg.cholesky(own), np.float64)
        return log_densities(away[None][:, :, columns], factors, known.failing)[0]

    def near(self, strings: Floats) -> Floats:
        """Return all strings."""
        return strings


@single_threaded
def contributions(whole: EmulatedData, drawn: WeightedStrings) -> list[Contribution]:
    """Return what all data leave of the box, then those without each experiment, and its alone.

    Parameters
    ----------
    whole
        Emulator of all data.
    drawn
        The posterior of all data.

    Returns
    -------
    list
        Empty where the data are of one experiment.
    """
    names = experiments_of(whole.data)
    if len(names) < 2:
        return []
    found = [_contribution(whole, "all", names, drawn)]
    for name in names:
        others = tuple(each for each in names if each != name)
        found.append(_of_some(whole, f"without {name}", others))
    if len(names) > 2:  # of two, each is without the other
        found += [_of_some(whole, f"{name} alone", (name,)) for name in names]
    return found


def _of_some(whole: EmulatedData, label: str, names: tuple[str, ...]) -> Contribution:
    """Return what the data of some experiments leave of the box."""
    of = DataOfSome(whole, names)
    prior = whole.box.even_strings(PRIOR_POINTS)
    drawn = sample_posterior(of, prior, of.log_density(prior), len(prior))
    return _contribution(whole, label, names, drawn)


def _contribution(
    whole: EmulatedData, label: str, names: tuple[str, ...], drawn: WeightedStrings
) -> Contribution:
    widths = contraction_of(whole.box, drawn)
    return Contribution(label, names, widths, drawn.volume, drawn.effective_size)


class PredictedDatum(NamedTuple):
    """Predictions of the posterior for a datum.

    Attributes
    ----------
    datum
        The datum: its name, quantity, weight, edges, time and unit, values and covariance.
    draws
        Predictions without errors of a measurement, in SI units, shape (draws, q).
    p_value
        Posterior predictive p-value: probability that a further measurement would differ more from
        what the string gives, averaged over the posterior. It is near 0 where the datum disagrees.
    outside
        Whether the median of a value is beyond what any string of the campaign gave.
    blind
        Whether each error of the datum is larger than all that the strings of the campaign differ
        by, so that the datum says nothing.
    """

    datum: Datum
    draws: Floats
    p_value: float
    outside: bool = False
    blind: bool = False

    @property
    def median(self) -> Floats:
        """Median prediction of each value, shape (q,)."""
        return np.median(self.draws, axis=0)

    def quantiles(self, shares: Sequence[float] = REPORTED_QUANTILES) -> Floats:
        """Return quantiles of the prediction of each value, shape (shares, q)."""
        return np.asarray(np.quantile(self.draws, shares, axis=0))

    @property
    def disagrees(self) -> bool:
        """Whether the datum disagrees with what all data together allow."""
        return self.p_value < UNLIKELY

    @property
    def verdict(self) -> str:
        """Faults of the prediction in a few words; empty if there are none."""
        faults = {
            "disagrees": self.disagrees,
            "outside of what strings gave": self.outside,
            "its error exceeds all that strings differ by": self.blind,
        }
        return ", ".join(text for text, is_so in faults.items() if is_so)

    def as_dict(self) -> dict[str, Any]:
        """Return the prediction as plain values, in SI units."""
        datum = self.datum
        edges = None if datum.edges is None else datum.edges.tolist()
        return {
            "name": datum.name,
            "quantity": datum.quantity,
            "weight": datum.own_weight,
            "time": datum.time,
            "edges": edges,
            "unit": datum.kind.unit,
            "measured": datum.values.tolist(),
            "error": datum.standard_errors.tolist(),
            "quantiles": self.quantiles().tolist(),
            "p_value": self.p_value,
            "disagrees": self.disagrees,
            "outside": self.outside,
            "blind": self.blind,
        }


def predict_data(of: EmulatedData, drawn: WeightedStrings) -> tuple[list[PredictedDatum], float]:
    """Return predictions of all data, and the posterior predictive p-value of all together.

    χ² of a further measurement, by the errors of measurement and emulator at a string, has the
    distribution of χ² of its rank. So its p-values need no draws.
    """
    from scipy.special import chdtrc

    random = of.stream(PREDICTIVE_STREAM)
    chosen = random.choice(len(drawn.weights), PREDICTIVE_DRAWS, p=drawn.weights)
    strings = drawn.strings[chosen]
    components, left_out = of.drawn_components(strings, random, given=True)
    values = of.values_of(components, left_out)
    away, covariances = of.framed_residuals(strings)
    p_values = []
    for rows in [slice(None), *of.frame.columns]:
        own = of.frame.roots[rows]
        factors = np.asarray(np.linalg.cholesky(own @ covariances @ own.T), np.float64)
        chi = chi_squares((away @ own.T)[None], factors)[0]
        p_values.append(float(np.mean(chdtrc(factors.shape[1], chi))))
    middle = np.median(values, axis=0)
    outside = (middle < of.reached[0]) | (middle > of.reached[1])
    differ = of.reached[1] - of.reached[0]  # inf of impacts
    found = []
    for datum, rows, p in zip(of.data, of.frame.rows, p_values[1:], strict=True):
        draws = datum.kind.within_limits(values[:, rows], of.lengths)
        blind = bool(np.all(datum.standard_errors > differ[rows]))
        found.append(PredictedDatum(datum, draws, p, bool(outside[rows].any()), blind))
    return found, p_values[0]


DatumPoint: TypeAlias = tuple[str, str, slice]
"""What is left out together, a datum with all classes of a curve or one impact of a list: its name,
its experiment, empty where there is none, and its directions among those of all data."""


def datum_points(of: EmulatedData) -> tuple[list[DatumPoint], Floats]:
    """Return what is left out together, and the directions, (p, p), of all of it in the frame."""
    turned, found = of.frame.roots.copy(), list[DatumPoint]()
    own_basis = of.frame.basis @ of.frame.roots.T
    for datum, rows, columns in zip(of.data, of.frame.rows, of.frame.columns, strict=True):
        is_square = rows.stop - rows.start == columns.stop - columns.start
        if datum.impacts is None or not is_square:
            found.append((datum.name, datum.experiment, columns))
            continue
        # Directions of a list mix its impacts; these are residuals over their standard errors.
        back = np.linalg.inv(own_basis[rows, columns]).T / datum.standard_errors[:, None]
        turned[columns] = back @ of.frame.roots[columns]
        for i, speed in enumerate(datum.impacts[:, 0].tolist()):
            place = columns.start + i
            name = f"{datum.name}: impact at {value_with_prefix(speed, 'm/s')}"
            found.append((name, datum.experiment, slice(place, place + 1)))
    return found, turned


def conditional_densities(of: EmulatedData, strings: Floats) -> Floats:
    """Return the log-density of each `datum_points` given the others, for strings: (n, points).

    Densities are those of data in units of their errors.
    """
    points, turned = datum_points(of)
    found = np.empty((len(strings), len(points)))
    for start in range(0, len(strings), STRINGS_AT_ONCE):
        some = slice(start, start + STRINGS_AT_ONCE)
        away, covariances = of.framed_residuals(strings[some])
        precision = np.linalg.inv(turned @ covariances @ turned.T)
        pulls = np.einsum("nab,nb->na", precision, away @ turned.T)
        for i, (*_, own) in enumerate(points):
            block, pull = precision[:, own, own], pulls[:, own]
            squares = np.einsum("na,na->n", pull, np.linalg.solve(block, pull[..., None])[..., 0])
            _, logarithm = np.linalg.slogdet(block)
            rank = own.stop - own.start
            found[some, i] = 0.5 * (logarithm - squares - rank * math.log(2.0 * math.pi))
    return found
