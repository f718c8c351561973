"""The strings and samples of a campaign file as labelled arrays: an xarray Dataset."""

from typing import TYPE_CHECKING, Final

import numpy as np

from agglom_mpi.analysis.tables import table_of
from agglom_mpi.errors import UserError, require_library
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
    """Return what is known of the file as a whole."""
    return {
        "title": data.title,
        "seed": data.seed,
        "campaign": data.campaign_text,
        "campaign_sha256": str(data.attributes["campaign_sha256"]),
        "state": data.live_status().state,
        "fresh_from": data.fresh_from,
        "with_unused": int(data.with_unused),
        "source": f"agglom_mpi {__version__}",
    }
