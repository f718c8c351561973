"""Posterior of the variables of a campaign: what is the same whatever was measured."""

from abc import ABC, abstractmethod
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any, Final, Generic, Protocol, TypeVar

import numpy as np

from agglom_mpi.config.coordinates import Coordinates
from agglom_mpi.declaration.spelling import suggestion
from agglom_mpi.emulation.gaussian_process import Floats
from agglom_mpi.errors import UserError
from agglom_mpi.inference.draw_groups import (
    DEFAULT_DRAWS,
    EqualDraws,
    Groups,
    Predicted,
    arviz_data,
    in_chains,
    independent_draws,
    posterior_groups,
    root_attributes,
)
from agglom_mpi.inference.posterior_sampling import MIN_SIZE, WeightedStrings
from agglom_mpi.inference.searched_box import SearchedBox
from agglom_mpi.inference.set_directions import MIN_FREE_SHARE, name_ends, touched_ends
from agglom_mpi.statistics import weighted_quantiles

if TYPE_CHECKING:
    import pandas as pd

REPORTED_QUANTILES: Final = (0.025, 0.25, 0.5, 0.75, 0.975)
"""Reported quantiles."""
CENTRAL: Final = (0.05, 0.95)
"""Quantiles at the ends of the central 90 %."""
PRIOR_WIDTH_POINTS: Final = 1 << 13
"""Number of even points of the box that show how wide the prior of each variable is."""


class PosteriorError(UserError, ValueError):
    """A posterior that cannot be computed, with the reason."""


class Emulated(Protocol):
    """Box and coordinates of the emulator that a posterior rests on."""

    box: SearchedBox
    coordinates: Coordinates


EmulatedKind = TypeVar("EmulatedKind", bound=Emulated)


@dataclass(frozen=True, eq=False, repr=False)
class Posterior(ABC, Generic[EmulatedKind]):
    """Weighted strings that stand for the posterior.

    Attributes
    ----------
    of
        The emulator that it rests on, with the search box.
    drawn
        The strings.
    """

    of: EmulatedKind
    drawn: WeightedStrings

    @property
    def strings(self) -> Floats:
        """Strings in SI units, shape (n, k)."""
        return self.drawn.strings

    @property
    def weights(self) -> Floats:
        """Weights of the strings, whose sum is 1, shape (n,)."""
        return self.drawn.weights

    @property
    def effective_size(self) -> float:
        """Number of independent strings that would be as informative."""
        return self.drawn.effective_size

    @property
    def method(self) -> str:
        """Either `importance weights` or `chain`."""
        return self.drawn.method

    @property
    def volume(self) -> float:
        """Share of the allowed part of the box in the smallest region with 90 % of the weight."""
        return self.drawn.region

    @property
    def warning(self) -> str:
        """Reasons for which the ranges may be wrong; empty if there are none."""
        return "; ".join(self._warnings())

    def _warnings(self) -> list[str]:
        """Return what `warning` joins."""
        own = ((each, self.touches[each.name]) for each in self.of.box.own)
        touched = ", ".join(name_ends(each, ends) for each, ends in own if ends)
        found = [f"the posterior touches {touched}, where its ranges end with the box"]
        found = found if touched else []
        if self.effective_size < MIN_SIZE:
            found.append(
                f"the effective size is {self.effective_size:.0f}, too small to trust the tails: "
                "the measurement leaves little of the box; pip install emcee for a Markov chain, "
                "or search a narrower box"
            )
        return found

    @cached_property
    def touches(self) -> dict[str, tuple[str, ...]]:
        """Ends of the box, `lower` and `upper`, that the posterior touches, by variable.

        Those of a variable of which the measurement says next to nothing are left out.
        """
        places, found = self.of.box.space.to_unit(self.strings), {}
        for name, mine in zip(self.of.box.names, places.T, strict=True):
            ends = touched_ends(mine, self.weights)
            free = len(ends) > 1 and self.contraction[name] >= MIN_FREE_SHARE
            found[name] = () if free else ends
        return found

    @property
    def draws(self) -> "pd.DataFrame":
        """The searched variables in SI units and the weight of each string, as a DataFrame."""
        return self.of.box.table(self.strings, weight=self.weights)

    def sample(self, n: int, seed: int = 0) -> "pd.DataFrame":
        """Draw n strings of equal weight, with replacement; raises ValueError for a wrong n."""
        n, seed = self.of.box.count("n", n, least=1), self.of.box.count("seed", seed)
        chosen = np.random.default_rng(seed).choice(len(self.weights), n, p=self.weights)
        return self.of.box.table(self.strings[chosen])

    def to_pandas(self) -> "pd.DataFrame":
        """Return the same as `draws`: units are in `.attrs["units"]`, and weights add up to 1."""
        return self.draws

    def to_arviz(self, draws: int = DEFAULT_DRAWS, seed: int = 0) -> Any:
        """Return the posterior as an `arviz.InferenceData`; as a DataTree from ArviZ 1 on.

        Groups, number of draws and seed are those of `groups`; raises MissingLibraryError without
        ArviZ.
        """
        return arviz_data(self.groups(draws, seed), self.attributes())

    def groups(self, draws: int = DEFAULT_DRAWS, seed: int = 0) -> Groups:
        """Return the groups of an ArviZ file as xarray Datasets by name.

        Of weighted strings at most `draws` of equal weight are drawn, none twice, in chains of
        independent draws; `sample_stats` has the `weight` that each string had. The steps of a
        Markov chain are of equal weight already, and all are kept: each walker is a chain. The
        effective size, which no number of draws can raise, is an attribute of `posterior`.
        """
        draws, seed = self.of.box.count("draws", draws, least=1), self.of.box.count("seed", seed)
        if self.drawn.walkers:
            chosen = np.arange(len(self.weights)).reshape(-1, self.drawn.walkers).T
        else:
            chosen = in_chains(independent_draws(self.weights, draws, seed))
        meaning = "weight of the string before it was drawn; the draws need no weights"
        stats = {"weight": (self.weights[chosen], meaning)}
        attributes = {
            "draws_are": f"the posterior, given {self.given}",
            "effective_size": self.effective_size,
            "method": self.method,
            "warning": self.warning,
        }
        equal = EqualDraws(self.strings[chosen], stats)
        random = np.random.default_rng([seed, 1])
        return posterior_groups(self.of.box, equal, attributes, self.predicted(random))

    @property
    @abstractmethod
    def given(self) -> str:
        """The measurement, in a few words."""

    @abstractmethod
    def predicted(self, random: np.random.Generator) -> Predicted:
        """Return the measured quantities, and what predicts measurements of them."""

    @abstractmethod
    def attributes(self) -> dict[str, Any]:
        """Return the attributes of an ArviZ file as a whole."""

    def quantiles(
        self, name: str, shares: tuple[float, ...] = REPORTED_QUANTILES
    ) -> tuple[float, ...]:
        """Return quantiles of a searched variable, in SI units; by default `REPORTED_QUANTILES`.

        Raises
        ------
        CampaignError
            If the campaign does not search a variable of that name.
        """
        if name not in self.of.box.names:
            hint = suggestion(name, self.of.box.names)
            raise self.of.box.mistaken(name, f"is no searched variable; {hint}")
        variable = self.of.box.own[self.of.box.names.index(name)]
        return weighted_quantiles(variable.values(self.strings), self.weights, shares)

    @cached_property
    def contraction(self) -> dict[str, float]:
        """Width of the central 90 % of each variable relative to the prior's, by name.

        Both widths are measured in the coordinate in which the variable is searched.
        """
        box = self.of.box
        prior = box.space.to_unit(box.even_strings(PRIOR_WIDTH_POINTS))
        mine, equal = box.space.to_unit(self.strings), np.full(len(prior), 1.0 / len(prior))
        found = {}
        for i, name in enumerate(box.names):
            low, high = weighted_quantiles(mine[:, i], self.weights, CENTRAL)
            least, most = weighted_quantiles(prior[:, i], equal, CENTRAL)
            found[name] = (high - low) / (most - least)
        return found

    @property
    def correlations(self) -> Floats:
        """Correlations of the searched variables, in the coordinates of the emulator, (d, d)."""
        covariance = self._covariance
        scale = np.sqrt(np.diag(covariance))
        return np.asarray(covariance / np.outer(scale, scale))

    @property
    def partial_correlations(self) -> Floats:
        """Correlations of two searched variables, the others kept, (d, d)."""
        d = len(self.of.box.names)
        precision = np.linalg.inv(self._covariance + 1e-12 * np.eye(d))
        scale = np.sqrt(np.diag(precision))
        return np.asarray(2.0 * np.eye(d) - precision / np.outer(scale, scale))

    @property
    def _covariance(self) -> Floats:
        own = self.of.coordinates.own(self.strings)
        return np.atleast_2d(np.cov(own.T, aweights=self.weights))

    def as_dict(self) -> dict[str, Any]:
        """Return the posterior without its draws as plain values.

        `variables` has the `quantiles` of each variable in SI units, whose names are in `units`.
        Rows and columns of both matrices of correlations are in the order of `variables`.
        `contraction` is the width of the central 90 % relative to the prior's, `touches` the ends
        of the box at which ranges end with it, and `volume` the share of the box in the smallest
        region with 90 % of the posterior.
        """
        names = self.of.box.names
        return {
            "effective_size": self.effective_size,
            "strings": len(self.weights),
            "method": self.method,
            "warning": self.warning or None,
            "quantiles": list(REPORTED_QUANTILES),
            "variables": {name: list(self.quantiles(name)) for name in names},
            "units": {each.name: each.unit for each in self.of.box.own},
            "contraction": self.contraction,
            "touches": {name: list(ends) for name, ends in self.touches.items()},
            "volume": self.volume,
            "correlations": self.correlations.tolist(),
            "partial_correlations": self.partial_correlations.tolist(),
        }

    def _root_attributes(self, criterion: str) -> dict[str, Any]:
        return root_attributes(self.of.box.campaign, criterion)
