"""The public campaign file: rows, tables, the best strings, and plots."""

import os
from collections.abc import Callable
from typing import TYPE_CHECKING, TypeVar

import numpy as np

from agglom_mpi.analysis import tables
from agglom_mpi.analysis.estimates import estimates_of
from agglom_mpi.analysis.ranking import order_by_estimates, search_order
from agglom_mpi.report.plots import Plots
from agglom_mpi.storage.access import NotACampaign
from agglom_mpi.storage.reader import CampaignData, read_campaign

if TYPE_CHECKING:
    import pandas as pd

T = TypeVar("T")

__all__ = ["CampaignFile", "NotACampaign", "open_campaign"]


class CampaignFile(Plots, CampaignData):
    """What is in a campaign file now: every call reads it anew.

    Methods give numpy rows as they are stored (columns in `storage.schema`); properties give pandas
    tables with units in `.attrs["units"]`; `plot_*` draw on axes of matplotlib.
    """

    def snapshot(self) -> CampaignData:
        """Return the rows as they are now, which the file of a running campaign goes on from."""
        return CampaignData(self.path, self.attributes)

    def rows(self, table: str) -> np.ndarray:
        """Read the rows of a table, (n,), in the order of their places."""
        return self.snapshot().rows(table)

    def derived(self, compute: Callable[[CampaignData], T]) -> T:
        """Return `compute` of the rows as they are now."""
        return compute(self.snapshot())

    @property
    def damaged(self) -> int:
        """Number of rows that are marked final but have a wrong checksum; they count as absent."""
        return self.snapshot().damaged

    @property
    def strings(self) -> "pd.DataFrame":
        """One row for each string: origin, parameters, judgement and processor time.

        Examples
        --------
        >>> import agglom_mpi
        >>> strings = agglom_mpi.open_campaign("quickstart.h5").strings
        >>> strings.attrs["units"]["hardness"]
        'Pa'
        >>> bool((strings["samples_used"] <= 30).all())
        True
        """
        return tables.table_of(self.snapshot(), "strings")

    @property
    def samples(self) -> "pd.DataFrame":
        """One row for each sample; `used` says whether it was judged, `fresh` if none ever is.

        Examples
        --------
        >>> import agglom_mpi
        >>> samples = agglom_mpi.open_campaign("quickstart.h5").samples
        >>> sorted(set(samples["state"]))
        ['completed']
        >>> ratios = samples[samples["fresh"]].groupby("string")["mean_radius_ratio"]
        >>> len(ratios.mean())
        6
        """
        return tables.table_of(self.snapshot(), "samples")

    @property
    def estimates(self) -> "pd.DataFrame":
        """One row for each string that was estimated again on fresh samples, in order of rank.

        `objective`, `standard_error` and the 95 % interval `lower` to `upper` are of the fresh
        samples; the search's own, biased, are `searched_objective` and `searched_standard_error`.
        """
        return tables.table_of(self.snapshot(), "estimates")

    @property
    def generations(self) -> "pd.DataFrame":
        """One row for each generation.

        Examples
        --------
        >>> import agglom_mpi
        >>> generations = agglom_mpi.open_campaign("quickstart.h5").generations
        >>> generations["generation"].tolist()
        [0, 1, 2]
        """
        return tables.table_of(self.snapshot(), "generations")

    @property
    def variables(self) -> "pd.DataFrame":
        """One row for each variable that the campaign uses: its unit and box."""
        return tables.table_of(self.snapshot(), "variables")

    def best(self, k: int = 1) -> "pd.DataFrame":
        """Best k judged strings, as they are known best.

        Those that were estimated again come in the order of that, and all others after them in
        the order of the search's own `objective`, which is biased; ties by number. If the search
        has gone on, and its best was not estimated yet, the order is its own.

        Examples
        --------
        >>> import agglom_mpi
        >>> best = agglom_mpi.open_campaign("quickstart.h5").best(6)
        >>> bool(best["estimate"].is_monotonic_increasing)
        True
        >>> best.attrs["units"]["relative_speed"]
        'm/s'
        """
        data = self.snapshot()
        table, estimates = tables.strings(data), estimates_of(data)
        judged = set(table["string"][table["samples_used"] > 0])  # a damaged row is absent
        own = search_order(data, data.result_rows())
        order = [string for string in order_by_estimates(own, estimates) if string in judged]
        frame = table.set_index("string", drop=False).loc[order[:k]].reset_index(drop=True)
        values = {estimate.string: estimate.objective for estimate in estimates}
        frame["estimate"] = [values.get(string, np.nan) for string in frame["string"]]
        frame.attrs["units"] = table.attrs["units"] | {"estimate": "1"}
        return frame


def open_campaign(path: str | os.PathLike[str]) -> CampaignFile:
    """Open a campaign file for reading.

    Raises
    ------
    NotACampaign
        If it is something else, truncated, damaged or of a newer format version.
    OSError
        If it is missing or cannot be read.

    Examples
    --------
    >>> import agglom_mpi
    >>> file = agglom_mpi.open_campaign("quickstart.h5")
    >>> file.status().state
    'finished'
    >>> len(file.best(3))
    3
    """
    data = read_campaign(path)
    return CampaignFile(data.path, data.attributes)
