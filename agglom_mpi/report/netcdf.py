"""NetCDF files that xarray and ArviZ read: draws of a posterior, and all samples."""

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

from agglom_mpi.analysis.sample_arrays import sample_arrays
from agglom_mpi.emulation.blas_threads import single_threaded
from agglom_mpi.errors import require_library
from agglom_mpi.formatting import pluralise
from agglom_mpi.inference.data_posterior import data_posterior
from agglom_mpi.inference.draw_groups import (
    DEFAULT_DRAWS,
    EqualDraws,
    Groups,
    in_chains,
    root_attributes,
    set_groups,
)
from agglom_mpi.inference.feasible_set import FeasibleSet, feasible_set
from agglom_mpi.report.set_files import SetRequest, is_of_data
from agglom_mpi.storage.files import atomic_file

if TYPE_CHECKING:
    import xarray as xr

    from agglom_mpi.storage.reader import CampaignData

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
    """
    if xarray is not None:
        arrays = sample_arrays(data)
        write_arrays(xarray, arrays)
        strings, samples = arrays.sizes["string"], int(arrays["present"].sum())
        yield f"{xarray}: {pluralise(strings, 'string')}, {pluralise(samples, 'sample')}"
    if arviz is not None:
        groups, attributes = draw_groups(data, request or SetRequest())
        write_groups(arviz, groups, attributes)
        posterior = groups["posterior"]
        draws = pluralise(posterior.sizes["chain"] * posterior.sizes["draw"], "draw")
        yield f"{arviz}: {draws} of {posterior.attrs['draws_are']}"
        if posterior.attrs.get("warning"):
            yield f"warning: {posterior.attrs['warning']}"


def draw_groups(data: "CampaignData", request: SetRequest) -> tuple[Groups, dict[str, Any]]:
    """Return the groups of draws, and the attributes of the file.

    They are draws of the posterior if the campaign has data or a measured mean is given, and else
    members of the feasible set, drawn uniformly in the box and kept with their probability.

    Raises
    ------
    NoFeasibleSetError, PosteriorError
        If there are none, with the reason.
    """
    if is_of_data(data, request):
        posterior = data.derived(data_posterior)
        return single_threaded(posterior.groups)(), posterior.attributes()
    found = feasible_set(data, request.tolerance)
    return _drawn(found, request), root_attributes(
        found.emulated.box.campaign, found.criterion.text
    )


@single_threaded
def _drawn(found: FeasibleSet, request: SetRequest) -> Groups:
    posterior = request.posterior_of(found)
    return members(found) if posterior is None else posterior.groups()


def members(found: FeasibleSet) -> Groups:
    """Return the groups of members of a set, of equal weight."""
    drawn = found.sample(DEFAULT_DRAWS)
    probability = in_chains(drawn.pop("probability").to_numpy())
    stats = {"probability": (probability, "probability that the string is a member")}
    strings = in_chains(found.emulated.box.strings(drawn))
    text = "members of the feasible set, uniform in the box; no measured mean is given"
    attributes = {"draws_are": text, "criterion": found.criterion.text}
    return set_groups(found.emulated.box, EqualDraws(strings, stats), attributes)


def write_groups(path: Path, groups: Groups, attributes: Mapping[str, Any]) -> None:
    """Write Datasets as the groups of a netCDF file; complete under its name, or absent.

    Raises
    ------
    FileExistsError
        If there is such a file already.
    OSError
        If it cannot be written.
    """
    import xarray as xr

    tree = xr.DataTree.from_dict(dict(groups))
    tree.attrs.update(attributes)
    _write(path, tree.to_netcdf(engine=ENGINE))


def write_arrays(path: Path, arrays: "xr.Dataset") -> None:
    """Write a Dataset as a netCDF file; errors as for `write_groups`."""
    encoding = {
        name: COMPRESSION
        for name, values in arrays.data_vars.items()
        if values.ndim == 2 and values.dtype != object
    }
    _write(path, arrays.to_netcdf(engine=ENGINE, encoding=encoding))


def _write(path: Path, content: memoryview) -> None:
    """Write a file at once: HDF5 would lock it again, and reports a full disc as a traceback."""
    with atomic_file(path) as temporary:
        temporary.write_bytes(content)
