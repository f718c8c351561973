"""Draws of a posterior or of a feasible set as the groups of an ArviZ file.

A group is an xarray Dataset. Its variables have the dimensions `chain` and `draw`, SI units in
`attrs["units"]`, and equal weight: what ArviZ computes of draws needs no weights.
"""

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any, Final, TypeVar

import numpy as np
from numpy.typing import NDArray

from agglom_mpi.errors import require_library
from agglom_mpi.inference.posterior_sampling import Measurement, Observed
from agglom_mpi.inference.searched_box import SearchedBox
from agglom_mpi.statistics import Floats
from agglom_mpi.version import __version__

if TYPE_CHECKING:
    import xarray as xr

    from agglom_mpi.config.campaign import Campaign

Number = TypeVar("Number", bound=np.generic)

Groups = dict[str, "xr.Dataset"]
"""Datasets by the names of their groups in ArviZ."""

PRIOR_DRAWS: Final = 1 << 12
"""Number of even points of the box that stand for the prior."""
DEFAULT_DRAWS: Final = 4000
"""Maximum number of draws of equal weight, unless another is asked for."""
CHAINS: Final = 4
"""Number of chains of independent draws: ArviZ compares several, each with at least four draws."""


def set_groups(
    box: SearchedBox,
    strings: Floats,
    stats: Mapping[str, tuple[Floats, str]],
    attributes: Mapping[str, Any],
) -> Groups:
    """Return `posterior`, `sample_stats` and `prior` of draws of equal weight.

    Parameters
    ----------
    box
        The search box.
    strings
        The draws in SI units, shape (chains, draws, k).
    stats
        Numbers of each draw by name, shape (chains, draws), and what each means.
    attributes
        What is known of the draws as a whole: attributes of the `posterior`.
    """
    require_library("xarray", "arviz", "draws for ArviZ")
    numbers = {
        name: (("chain", "draw"), values, {"units": "1", "long_name": meaning})
        for name, (values, meaning) in stats.items()
    }
    return {
        "posterior": _variables(box, strings, attributes),
        "sample_stats": _dataset(numbers),
        "prior": _variables(
            box, prior_strings(box), {"draws_are": "even points of the search box"}
        ),
    }


def prior_strings(box: SearchedBox) -> Floats:
    """Return even points of what is allowed of the box, (chains, n, k), for the prior."""
    return in_chains(box.even_strings(PRIOR_DRAWS))


def in_chains(draws: NDArray[Number]) -> NDArray[Number]:
    """Return independent draws, (n, …), as chains of equal length, (chains, n // chains, …)."""
    chains = CHAINS if len(draws) >= CHAINS**2 else 1
    length = len(draws) // chains
    return draws[: chains * length].reshape(chains, length, *draws.shape[1:])


def independent_draws(weights: Floats, most: int, seed: int) -> NDArray[np.int64]:
    """Return which weighted strings are draws of equal weight, (n,), in random order.

    A string is drawn with the probability n·weight (systematic sampling), and none twice, as n is
    at most 1 over the largest weight; the effective size is at least that.
    """
    random = np.random.default_rng(seed)
    count = max(1, min(most, int(1.0 / weights.max())))
    order = random.permutation(len(weights))
    ends = np.cumsum(weights[order])
    places = (random.random() + np.arange(count)) / count
    chosen = np.searchsorted(ends / ends[-1], places, side="right")
    return np.asarray(random.permutation(order[np.minimum(chosen, len(order) - 1)]))


def posterior_groups(
    of: Measurement,
    strings: Floats,
    stats: Mapping[str, tuple[Floats, str]],
    attributes: Mapping[str, Any],
    random: np.random.Generator,
) -> Groups:
    """Return the groups of `set_groups`, and those of what was measured.

    `observed_data` has the measured values, `constant_data` their standard errors, and
    `posterior_predictive` and `prior_predictive` have measurements of equal errors, as the
    emulator predicts them.

    Parameters
    ----------
    of
        What was measured.
    strings, stats, attributes
        As for `set_groups`.
    random
        Stream of the predicted measurements.
    """
    groups, observed = set_groups(of.box, strings, stats, attributes), list(of.observed())
    drawn = {
        "posterior_predictive": (strings, True),
        "prior_predictive": (prior_strings(of.box), False),
    }
    for group, (some, given) in drawn.items():
        values = of.measurements(some.reshape(-1, some.shape[-1]), random, given)
        shape = (*some.shape[:2], -1)
        groups[group] = _measured(
            observed, [each.reshape(shape) for each in values], ("chain", "draw")
        )
    groups["observed_data"] = _measured(observed, [each.values for each in observed])
    errors = [each.errors for each in observed]
    groups["constant_data"] = _measured(observed, errors, suffix="_standard_error")
    return groups


def density_group(names: Sequence[str], densities: Floats) -> "xr.Dataset":
    """Return log-densities of data given the others, (chains, draws, data), by their names."""
    meaning = {
        "units": "1",
        "long_name": "logarithm of the density of each datum, in units of its error, given the "
        "others",
    }
    found = _dataset({"data": (("chain", "draw", "datum"), densities, meaning)})
    return found.assign_coords(datum_name=("datum", list(names)))


def _measured(
    observed: Sequence[Observed],
    values: Sequence[Floats],
    first: tuple[str, ...] = (),
    suffix: str = "",
) -> "xr.Dataset":
    """Return values of measured quantities, whose dimension follows the `first` ones."""
    columns = {}
    for each, mine in zip(observed, values, strict=True):
        columns[each.name + suffix] = ((*first, each.dimension), mine, each.attributes)
    return _dataset(columns)


def root_attributes(campaign: "Campaign", criterion: str) -> dict[str, Any]:
    """Return the attributes of the whole file: the campaign, its seed and this program.

    Parameters
    ----------
    campaign
    criterion
        What draws are compatible with.
    """
    return {
        "title": campaign.title,
        "seed": campaign.seed,
        "campaign": campaign.text,
        "criterion": criterion,
        "inference_library": "agglom_mpi",
        "inference_library_version": __version__,
    }


def arviz_data(groups: Groups, attributes: Mapping[str, Any]) -> Any:
    """Return groups as an `arviz.InferenceData`; from ArviZ 1 on, as the DataTree in its place.

    Raises
    ------
    MissingLibraryError
        If ArviZ is not installed.
    """
    require_library("arviz", "arviz", "draws for ArviZ")
    import arviz

    # From ArviZ 1 on the name is no attribute, but a getter that warns and returns DataTree.
    if (kind := vars(arviz).get("InferenceData")) is not None:
        return kind(attrs=dict(attributes), **groups)
    import xarray as xr

    tree = xr.DataTree.from_dict(dict(groups))
    tree.attrs.update(attributes)
    return tree


def _variables(box: SearchedBox, strings: Floats, attributes: Mapping[str, Any]) -> "xr.Dataset":
    """Return the searched variables of strings, (chains, draws, k)."""
    flat = strings.reshape(-1, strings.shape[-1])
    columns = {
        each.name: (
            ("chain", "draw"),
            each.values(flat).reshape(strings.shape[:2]),
            {
                "units": each.unit,
                "long_name": each.name.replace("_", " "),
                "lower": each.lower,
                "upper": each.upper,
            },
        )
        for each in box.own
    }
    return _dataset(columns, attributes)


def _dataset(
    columns: Mapping[str, tuple[tuple[str, ...], Floats, Mapping[str, Any]]],
    attributes: Mapping[str, Any] | None = None,
) -> "xr.Dataset":
    """Return a Dataset of columns, with numbers from 0 as the coordinates of its dimensions."""
    import xarray as xr

    found = xr.Dataset(dict(columns), attrs=dict(attributes or {}))
    return found.assign_coords({name: np.arange(size) for name, size in found.sizes.items()})
