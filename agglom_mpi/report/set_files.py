"""The feasible set of a campaign file as text or JSON, and its tables as files."""

import json
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

from agglom_mpi.analysis.tables import with_units
from agglom_mpi.config.plan import DEFAULT_TOLERANCE
from agglom_mpi.emulation.blas_threads import single_threaded
from agglom_mpi.errors import require_library
from agglom_mpi.formatting import without_nan
from agglom_mpi.inference.data_posterior import data_posterior, measurement_of
from agglom_mpi.inference.emulated_set import tolerance_of
from agglom_mpi.inference.feasible_set import FeasibleSet
from agglom_mpi.report.set_summary import grid_table, set_as_dict, set_text
from agglom_mpi.storage.files import atomic_file, require_absent, require_writable_folder
from agglom_mpi.storage.recorded_campaign import recorded_campaign, recorded_objective

if TYPE_CHECKING:
    import pandas as pd

    from agglom_mpi.inference.next_measurement import NextMeasurements
    from agglom_mpi.inference.posterior import Posterior
    from agglom_mpi.storage.reader import CampaignData


class SetRequest(NamedTuple):
    """Options of a report on a feasible set.

    Attributes
    ----------
    tolerance
        As a number, or as a text such as `5%`.
    robust
        Deviations that probabilities are averaged over, by name.
    measured, error
        A measured mean and its standard error, for the posterior; None: no posterior.
    draws, grid
        CSV files to write; None: do not.
    """

    tolerance: float | str = DEFAULT_TOLERANCE
    measured: float | str | None = None
    error: float | str | None = None
    draws: Path | None = None
    grid: Path | None = None
    robust: Mapping[str, float | str] = {}

    def check(self, data: "CampaignData", made: Path | None = None) -> None:
        """Refuse what cannot be computed or written, before either begins.

        Parameters
        ----------
        data
        made
            A folder that will be made for files to be written into.

        Raises
        ------
        ArgumentError, PosteriorError
            If a number is impossible, or the objective allows no posterior.
        OSError
            If a file exists already, or its folder cannot be written.
        """
        tolerance = tolerance_of(data, self.tolerance)
        if self.measured is not None and self.error is not None:
            quantities = recorded_objective(data).criterion(tolerance).quantities
            measurement_of(recorded_campaign(data), quantities, self.measured, self.error)
        for path in (self.draws, self.grid):
            check_new(path, made)

    def posterior_of(self, found: FeasibleSet) -> "Posterior | None":
        """Return the posterior that is asked for, None if none is, or the set is not known."""
        if self.measured is None or self.error is None or not found.calibration.passed:
            return None
        return found.posterior(self.measured, self.error)

    def found(
        self, data: "CampaignData", made: Path | None = None
    ) -> "tuple[FeasibleSet, Posterior | None]":
        """Return the set and the posterior that is asked for; write the files, if it is known.

        The folder `made` is made for them.
        """
        found = FeasibleSet(data, self.tolerance, self.robust)
        posterior = self.posterior_of(found)
        if made is not None:
            made.mkdir(parents=True, exist_ok=True)
        if self.grid is not None and found.calibration.passed:
            write_table(self.grid, grid_table(found))
        if self.draws is not None and posterior is not None:
            write_table(self.draws, posterior.draws)
        return found, posterior


class PosteriorRequest(NamedTuple):
    """Options of a report on the posterior of all data.

    Attributes
    ----------
    what_next
        Whether to show what to measure next.
    table
        CSV file to write with all measurements that could be made; None: do not.
    """

    what_next: bool = False
    table: Path | None = None

    def check(self, made: Path | None = None) -> None:
        """Refuse a file that cannot be written, before anything is computed.

        Parameters
        ----------
        made
            A folder that will be made for files to be written into.

        Raises
        ------
        OSError
            If the file exists already, or its folder cannot be written.
        """
        check_new(self.table, made)

    def found(self, posterior: "Posterior") -> "NextMeasurements | None":
        """Return what to measure next, if that is asked for, and write the table."""
        if not self.what_next:
            return None
        found = posterior.next_measurements()
        if self.table is not None:
            write_table(self.table, found.table)
        return found


@single_threaded
def set_report(data: "CampaignData", request: SetRequest, as_json: bool, **further: Any) -> Any:
    """Return the feasible set of a campaign file as a renderable, or as JSON; write its files.

    JSON has `further` entries, too.

    Raises
    ------
    FileExistsError
        If there is a file of that name already.
    NoFeasibleSetError, PosteriorError, MissingLibraryError
        If there is none, with the reason.
    """
    require_library("pandas", "report", "feasible sets")
    request.check(data)
    found, posterior = request.found(data)
    if as_json:
        return _json(set_as_dict(found, posterior) | further)
    return set_text(found, posterior)


def write_json(path: Path, data: "CampaignData", request: SetRequest | None) -> None:
    """Write the posterior of all data of a campaign as JSON; without data, the feasible set.

    Raises
    ------
    NoFeasibleSetError, PosteriorError, MissingLibraryError
        If there is none, with the reason.
    """
    if is_of_data(data, request):
        text = _json({"posterior": data.derived(data_posterior).as_dict()})
    else:
        text = set_report(data, request or SetRequest(), as_json=True)
    with atomic_file(path) as temporary:
        temporary.write_text(f"{text}\n", encoding="utf-8")


def _json(values: dict[str, Any]) -> str:
    return json.dumps(without_nan(values), indent=2, ensure_ascii=False, allow_nan=False)


def is_of_data(data: "CampaignData", request: SetRequest | None) -> bool:
    """Return whether the posterior of a campaign's data is meant: no measured mean is given."""
    return data.sizes.census is not None and (request is None or request.measured is None)


def check_new(path: Path | None, made: Path | None) -> None:
    """Raise an OSError if a file that is asked for is there, or cannot be made; `made` will be."""
    if path is not None:
        require_absent(path)
        if made is None or path.parent.resolve() != made.resolve():
            require_writable_folder(path)


def write_table(path: Path, table: "pd.DataFrame") -> None:
    """Write a table as CSV with units in its headings; complete under its name, or absent."""
    with atomic_file(path) as temporary:
        with_units(table).to_csv(temporary, index=False, na_rep="nan", lineterminator="\n")
