"""Contribution of each experiment of a campaign: posteriors without it, and of it alone.

They rest on the emulator of all data. What it says of some of them is the marginal of its normal
distribution, so that nothing is fitted anew.
"""

from typing import Any, Final, NamedTuple

import numpy as np

from agglom_mpi.emulation.blas_threads import single_threaded
from agglom_mpi.inference.data_emulator import EmulatedData, log_densities
from agglom_mpi.inference.posterior_sampling import (
    MAX_LOGARITHM_AWAY,
    PRIOR_POINTS,
    WeightedStrings,
    contraction_of,
    sample_posterior,
)
from agglom_mpi.measurements.datum import experiments_of
from agglom_mpi.statistics import Floats

AT_ONCE: Final = 2048
"""Maximum number of strings whose covariances of all data are kept together."""


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
