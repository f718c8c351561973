"""Recorded strings and samples, to be simulated again and compared."""

from collections.abc import Iterator
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from agglom_mpi.config.yaml_source import CampaignError, Problem
from agglom_mpi.measurements.layout import prefix_of
from agglom_mpi.outcome import COLUMNS, COMPLETED, SPIN_COLUMNS, SPIN_UNITS, outcome_type
from agglom_mpi.statistics import Floats

if TYPE_CHECKING:
    from agglom_mpi.config.campaign import Campaign
    from agglom_mpi.simulation.sample import Outcome
    from agglom_mpi.storage.reader import CampaignData

AGREEMENT: Final = {
    True: "identical to the recorded sample",
    False: "differs from the recorded sample",
}
"""Verdict on a resimulated sample, by `is_same`."""

COMPARED: Final = 3
"""Number of samples that a check of a file with code of one's own simulates again."""


def recorded_parameters(data: "CampaignData", string: int | None) -> Floats:
    """Return the parameters of a string, (k,); raises CampaignError if the file has none."""
    if string is not None and string in data.parameters:
        return data.parameters[string].copy()
    said = "is missing" if string is None else f"is {string}"
    raise mistaken(data.path, "--string", f"{said}; allowed: 0 to {len(data.parameters) - 1}")


def recorded_sample(data: "CampaignData", string: int, sample: int) -> np.void:
    """Return a row of `/samples`; raises CampaignError if there is none."""
    rows = data.sample_rows(string)
    for row in rows:
        if row["sample"] == sample:
            return row
    last = int(rows["sample"].max()) if len(rows) else -1
    message = f"is {sample}, which string {string} does not have; recorded: 0 to {last}"
    raise mistaken(data.path, "--sample", message)


def row_of_experiment(row: np.void, experiment: str) -> np.void:
    """Return what a row of `/samples` has of one experiment, by `outcome_type`."""
    prefix, names = prefix_of(experiment), {*(row.dtype.names or ())}
    found = np.zeros(1, outcome_type({f"{prefix}{name}" for name in SPIN_UNITS} <= names))
    for name in found.dtype.names or ():
        found[name] = row[f"{prefix}{name}"]
    return found[0]


def simulated_again(
    data: "CampaignData", string: int, sample: int, frames: Any = None
) -> "Outcome":
    """Return the outcome of a recorded sample that is simulated again; raises a RuntimeError.

    Parameters
    ----------
    data
    string, sample
    frames
        Number of frames to take, or their times in s; None: none.
    """
    from agglom_mpi.storage.recorded_campaign import recorded_campaign
    from agglom_mpi.verbs.simulate import simulate

    campaign, parameters = recorded_campaign(data), data.parameters[string]
    return simulate(campaign, parameters, campaign.first_sample(string) + sample, frames=frames)


def is_same(stored: np.void, computed: np.void, version: int) -> bool:
    """Return whether two rows of `/samples` have the same outcome, bit for bit.

    Only columns that files of the stored row's format `version` have are compared.
    """
    names = {*(stored.dtype.names or ())} & {*(computed.dtype.names or ())}
    return all(
        stored[column.name].tobytes() == computed[column.name].tobytes()
        for column in (*COLUMNS, *SPIN_COLUMNS)
        if column.since <= version and column.name in names
    )


def is_same_sample(stored: np.void, outcome: "Outcome", version: int, with_function: bool) -> bool:
    """Return whether a sample gives its row again, `with_function` also what that returned."""
    values = {"objective": outcome.objective, **outcome.quantities} if with_function else {}
    same = all(np.float64(value) == stored[name] for name, value in values.items())
    return same and is_same(stored, outcome.record, version)


def samples_that_differ(data: "CampaignData", campaign: "Campaign") -> Iterator[str]:
    """Simulate the fastest stored samples again; yield a line on each that gives another row."""
    from agglom_mpi.verbs.simulate import simulate

    rows = data.searched_samples
    rows = rows[rows["state"] == COMPLETED]
    for row in rows[np.argsort(rows["seconds"], kind="stable")[:COMPARED]]:
        string, sample = int(row["string"]), int(row["sample"])
        number = campaign.first_sample(string) + sample
        again = simulate(campaign, data.parameters[string], number)
        if not is_same_sample(row, again, data.sizes.version, bool(campaign.user_function)):
            yield f"samples: sample {sample} of string {string} {AGREEMENT[False]}"


def mistaken(source: object, field: str, message: str) -> CampaignError:
    """Return the error for a wrong option of a command."""
    return CampaignError(Problem(str(source), None, field, message))
