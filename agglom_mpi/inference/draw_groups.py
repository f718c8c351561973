"""Draws of a posterior or of a feasible set as the groups of an ArviZ file.

A group is an xarray Dataset. Its variables have the dimensions `chain` and `draw`, SI units in
`attrs["units"]`, and equal weight: what ArviZ computes of draws needs no weights.
"""

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any, Final, NamedTuple

import numpy as np

from agglom_mpi.emulation.gaussian_process import Floats
from agglom_mpi.errors import require_library
from agglom_mpi.inference.membership import EmulatedBox
from agglom_mpi.inference.searched_box import SearchedBox
from agglom_mpi.version import __version__

if TYPE_CHECKING:
    import xarray as xr

Groups = dict[str, "xr.Dataset"]
"""Datasets by the names of their groups in ArviZ."""

PRIOR_DRAWS: Final = 1 << 12
"""Number of even points of the box that stand for the prior."""
DEFAULT_DRAWS: Final = 4000
"""Number of draws of equal weight, unless another is asked for."""
MEASUREMENT: Final = "measurement"
"""Dimension of the one measured number."""


class EqualDraws(NamedTuple):
    """Strings of equal weight.

    Attributes
    ----------
    strings
        In SI units, shape (chains, draws, k).
    stats
        Numbers of each draw by name, shape (chains, draws), and what each means.
    """

    strings: Floats
    stats: dict[str, tuple[Floats, str]]


class Measurement(NamedTuple):
    """A measured mean and its standard error; `name` is that of the quantity."""

    name: str
    value: float
    error: float


def require_xarray() -> None:
    """Raise a MissingLibraryError unless xarray is installed."""
    require_library("xarray", "arviz", "draws for ArviZ")


def set_groups(emulated: EmulatedBox, draws: EqualDraws, attributes: Mapping[str, Any]) -> Groups:
    """Return `posterior`, `sample_stats` and `prior` of draws.

    Parameters
    ----------
    emulated
        The emulated box of the feasible set.
    draws
        The draws.
    attributes
        What is known of the draws as a whole: attributes of the `posterior`.
    """
    require_xarray()
    prior = prior_strings(emulated)
    return {
        "posterior": _variables(emulated.box, draws.strings, attributes),
        "sample_stats": _numbers(draws.stats),
        "prior": _variables(emulated.box, prior, {"draws_are": "even points of the search box"}),
    }


def prior_strings(emulated: EmulatedBox) -> Floats:
    """Return even points of what is allowed of the box, (1, n, k), which stand for the prior."""
    return emulated.box.even_strings(PRIOR_DRAWS)[None]


def posterior_groups(
    emulated: EmulatedBox,
    draws: EqualDraws,
    measured: Measurement,
    attributes: Mapping[str, Any],
    seed: int,
) -> Groups:
    """Return the groups of `set_groups`, and those of a measurement.

    `observed_data` has the measured mean, `constant_data` its standard error, and
    `posterior_predictive` and `prior_predictive` have measurements of equal error, as the
    emulator predicts them.

    Parameters
    ----------
    emulated, draws, attributes
        As for `set_groups`.
    measured
        The measurement.
    seed
        Seed of the predicted measurements.
    """
    groups, random = set_groups(emulated, draws, attributes), np.random.default_rng([seed, 1])
    unit, error = _unit_of(measured.name), measured.error
    predictions = {
        "posterior_predictive": _given_measurement(_emulated(emulated, draws.strings), measured),
        "prior_predictive": _emulated(emulated, prior_strings(emulated)),
    }
    for group, (mean, deviation) in predictions.items():
        values = random.normal(mean, np.hypot(deviation, error))[..., None]
        dimensions = ("chain", "draw", MEASUREMENT)
        groups[group] = _dataset({measured.name: (dimensions, values, unit)})
    data = {
        "observed_data": (measured.name, measured.value),
        "constant_data": (f"{measured.name}_standard_error", error),
    }
    for group, (name, value) in data.items():
        groups[group] = _dataset({name: ((MEASUREMENT,), np.array([value]), unit)})
    return groups


def root_attributes(emulated: EmulatedBox) -> dict[str, Any]:
    """Return the attributes of the whole file: the campaign, its seed and this program."""
    campaign = emulated.box.campaign
    return {
        "title": campaign.title,
        "seed": campaign.seed,
        "campaign": campaign.text,
        "criterion": emulated.criterion.text,
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

    if (kind := getattr(arviz, "InferenceData", None)) is not None:
        return kind(attrs=dict(attributes), **groups)
    import xarray as xr

    tree = xr.DataTree.from_dict(dict(groups))
    tree.attrs.update(attributes)
    return tree


def _unit_of(name: str) -> dict[str, str]:
    """Return the attributes of a compared quantity, which has no unit."""
    return {"units": "1", "long_name": "mean b/b0" if name == "mean_radius_ratio" else name}


def _emulated(emulated: EmulatedBox, strings: Floats) -> tuple[Floats, Floats]:
    """Return emulated means and their standard deviations, each of shape (chains, draws)."""
    known = emulated.known(strings.reshape(-1, strings.shape[-1]))
    shape = strings.shape[:2]
    return known.mean.reshape(shape), known.deviation.reshape(shape)


def _given_measurement(
    predicted: tuple[Floats, Floats], measured: Measurement
) -> tuple[Floats, Floats]:
    """Return means and standard deviations of the true mean of strings, given the measured one.

    The error of the emulator at a string is the same for every measurement, so that a measured
    mean narrows it down, too.
    """
    mean, deviation = predicted
    share = deviation**2 / (deviation**2 + measured.error**2)
    return mean + share * (measured.value - mean), measured.error * np.sqrt(share)


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


def _numbers(stats: Mapping[str, tuple[Floats, str]]) -> "xr.Dataset":
    return _dataset(
        {
            name: (("chain", "draw"), values, {"units": "1", "long_name": meaning})
            for name, (values, meaning) in stats.items()
        }
    )


def _dataset(
    columns: Mapping[str, tuple[tuple[str, ...], Floats, dict[str, Any]]],
    attributes: Mapping[str, Any] | None = None,
) -> "xr.Dataset":
    """Return a Dataset of columns, with numbers from 0 as the coordinates of its dimensions."""
    import xarray as xr

    found = xr.Dataset(dict(columns), attrs=dict(attributes or {}))
    return found.assign_coords({name: np.arange(size) for name, size in found.sizes.items()})
