"""NetCDF files that xarray and ArviZ read: draws of a posterior, and all samples as a Dataset."""

from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from agglom_mpi.analysis.tables import table_of
from agglom_mpi.emulation.blas_threads import single_threaded
from agglom_mpi.errors import UserError, require_library
from agglom_mpi.formatting import pluralise
from agglom_mpi.inference.data_posterior import data_posterior
from agglom_mpi.inference.draw_groups import (
    DEFAULT_DRAWS,
    Groups,
    in_chains,
    root_attributes,
    set_groups,
)
from agglom_mpi.inference.feasible_set import feasible_set
from agglom_mpi.report.set_files import SetRequest, is_of_data
from agglom_mpi.storage.files import atomic_file
from agglom_mpi.storage.lock import live_status
from agglom_mpi.version import __version__

if TYPE_CHECKING:
    import pandas as pd
    import xarray as xr

    from agglom_mpi.storage.reader import CampaignData


MAX_CELLS: Final = 1 << 28
"""Maximum number of values in the padded arrays of samples: 2 GiB in memory."""
PREFIX: Final = "string_"
"""Begins the names of columns of strings that samples have, too, such as `string_objective`."""
TEXTS: Final = {"state": "absent", "reason": ""}
"""Columns of texts, and their value where there is no sample."""


class TooManySamplesError(UserError, ValueError):
    """More samples than padded arrays have room for."""


def sample_arrays(data: "CampaignData") -> "xr.Dataset":
    """Return the strings and samples of a campaign file, with the dimensions `string` and `sample`.

    Columns of strings have the one dimension `string`. Those whose names are taken begin with
    `string_`. Columns of samples have both dimensions. Strings have different numbers of samples,
    and fresh samples are numbered apart: where there is no sample, `present` is False and numbers
    are nan, so that means over `sample`, which skip nan, are those of the samples that exist.
    Samples that ran ahead unused are there only if the file was opened `with_unused`.
    Units are in `attrs["units"]`.

    Raises
    ------
    TooManySamplesError
        If the padded arrays would exceed `MAX_CELLS`.
    MissingLibraryError
        If xarray is not installed.
    """
    require_library("xarray", "arviz", "labelled arrays")
    import xarray as xr

    strings, samples = table_of(data, "strings"), table_of(data, "samples")
    samples = samples[samples["string"].isin(strings["string"])]
    numbers, which = np.unique(samples["sample"], return_inverse=True)
    cells = len(strings) * len(numbers) * samples.shape[1]
    if cells > MAX_CELLS:
        raise TooManySamplesError(
            f"{data.path}: {len(samples)} samples of {len(strings)} strings would fill padded "
            f"arrays of {8 * cells / 2**30:.1f} GiB; at most {8 * MAX_CELLS / 2**30:.0f} GiB are "
            "written: use --csv"
        )
    found = xr.Dataset(attrs=_attributes(data))
    found = found.assign_coords(string=strings["string"].to_numpy(), sample=numbers)
    taken = {*samples, "present"}
    # Names that stay are given first.
    names = [str(name) for name in strings.columns.drop("string")]
    for name in sorted(names, key=lambda name: name in taken):
        values = strings[name]
        own = f"{PREFIX}{name}" if name in taken else name
        while own in found:  # as a derived column may be called
            own = f"{PREFIX}{own}"
        found[own] = ("string",), values.to_numpy(), _units(strings, name)
    order = np.argsort(strings["string"].to_numpy(), kind="stable")
    places = order[np.searchsorted(strings["string"].to_numpy()[order], samples["string"])]
    shape = len(strings), len(numbers)
    present = np.zeros(shape, bool)
    present[places, which] = True
    found["present"] = ("string", "sample"), present, {"long_name": "whether there is a sample"}
    for column, values in samples.drop(columns=["string", "sample"]).items():
        padded = _padding(str(column), values, shape)
        padded[places, which] = values.to_numpy()
        found[str(column)] = ("string", "sample"), padded, _units(samples, str(column))
    return found


def _padding(name: str, values: "pd.Series", shape: tuple[int, int]) -> np.ndarray:
    """Return what a column of samples is where there is no sample, in an array of a shape."""
    if name in TEXTS:
        return np.full(shape, TEXTS[name], object)
    if values.dtype == bool:
        return np.zeros(shape, bool)
    return np.full(shape, np.nan)


def _units(table: "pd.DataFrame", name: str) -> dict[str, str]:
    unit = table.attrs["units"].get(name, "")
    return {"units": unit, "long_name": name.replace("_", " ")} if unit else {}


def _attributes(data: "CampaignData") -> dict[str, str | int]:
    return {
        "title": data.title,
        "seed": int(data.attributes["seed"]),
        "campaign": data.campaign_text,
        "campaign_sha256": str(data.attributes["campaign_sha256"]),
        "state": live_status(data).state,
        "fresh_from": data.fresh_from,
        "with_unused": int(data.with_unused),
        "source": f"agglom_mpi {__version__}",
    }


ENGINE: Final = "h5netcdf"
"""Library that xarray writes with: the lightest one that can write groups."""
COMPRESSION: Final = {"zlib": True, "complevel": 4}
"""Compression of padded arrays, which are mostly empty."""


def require_netcdf() -> None:
    """Raise a MissingLibraryError unless netCDF can be written."""
    for name in ("xarray", ENGINE):
        require_library(name, "arviz", "netCDF files")


def write_netcdf(
    data: "CampaignData", xarray: Path | None, arviz: Path | None, request: SetRequest | None
) -> Iterator[str]:
    """Write the files that are asked for, and yield a line on each.

    Parameters
    ----------
    data
    xarray
        Path of the file with strings and samples; None: do not write it.
    arviz
        Path of the file with draws; None: do not write it.
    request
        Which draws; None: those of a feasible set with the default tolerance.

    Raises
    ------
    FileExistsError
        If there is such a file already.
    NoFeasibleSetError, PosteriorError
        If there are no draws, with the reason.
    OSError
        If a file cannot be written.
    """
    import xarray as xr

    if xarray is not None:
        arrays = sample_arrays(data)
        encoding = {
            name: COMPRESSION
            for name, values in arrays.data_vars.items()
            if values.ndim == 2 and values.dtype != object
        }
        _write(xarray, arrays.to_netcdf(engine=ENGINE, encoding=encoding))
        strings, samples = arrays.sizes["string"], int(arrays["present"].sum())
        yield f"{xarray}: {pluralise(strings, 'string')}, {pluralise(samples, 'sample')}"
    if arviz is not None:
        groups, attributes = _draw_groups(data, request or SetRequest())
        tree = xr.DataTree.from_dict(dict(groups))
        tree.attrs.update(attributes)
        _write(arviz, tree.to_netcdf(engine=ENGINE))
        posterior = groups["posterior"]
        draws = pluralise(posterior.sizes["chain"] * posterior.sizes["draw"], "draw")
        yield f"{arviz}: {draws} of {posterior.attrs['draws_are']}"
        if posterior.attrs.get("warning"):
            yield f"warning: {posterior.attrs['warning']}"


@single_threaded
def _draw_groups(data: "CampaignData", request: SetRequest) -> tuple[Groups, dict[str, Any]]:
    """Return the groups of draws, and the attributes of the file.

    They are draws of the posterior if the campaign has data or a measured mean is given, and else
    members of the feasible set, drawn uniformly in the box and kept with their probability.
    """
    if is_of_data(data, request):
        of_data = data.derived(data_posterior)
        return of_data.groups(), of_data.attributes()
    found = feasible_set(data, request.tolerance, request.robust)
    box, text = found.emulated.box, found.criterion.text
    if (posterior := request.posterior_of(found)) is not None:
        return posterior.groups(), root_attributes(box.campaign, text)
    drawn = found.sample(DEFAULT_DRAWS)
    probability = in_chains(drawn.pop("probability").to_numpy())
    stats = {"probability": (probability, "probability that the string is a member")}
    about = "members of the feasible set, uniform in the box; no measured mean is given"
    attributes = {"draws_are": about, "criterion": text}
    groups = set_groups(box, in_chains(box.strings(drawn)), stats, attributes)
    return groups, root_attributes(box.campaign, text)


def _write(path: Path, content: memoryview) -> None:
    """Write a file at once: HDF5 would lock it again, and reports a full disc as a traceback."""
    with atomic_file(path) as temporary:
        temporary.write_bytes(content)
