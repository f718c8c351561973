"""Variables of a campaign file with their ranges, and derived columns of its strings."""

from collections.abc import Sequence
from typing import TYPE_CHECKING, Final

import numpy as np

from agglom_mpi.analysis.estimates import kept
from agglom_mpi.config.quantities import DerivedColumn, columns_of
from agglom_mpi.statistics import Floats
from agglom_mpi.storage.recorded_campaign import code_note, recorded_campaign
from agglom_mpi.storage.schema import INVERSION, parameters_of
from agglom_mpi.variables import LOGARITHMIC, VOLUME_FRACTION, Variable, VariableTable

if TYPE_CHECKING:
    from agglom_mpi.config.campaign import Campaign
    from agglom_mpi.storage.reader import CampaignData

DERIVING_KEYS: Final = ("derived", "volume_fraction", "grain_diameter", "grain_radius", "sizes")
"""Keys of a campaign file; a campaign with derived columns has at least one of them."""


def may_have_key(data: "CampaignData", key: str) -> bool:
    """Return False only if the text of a campaign cannot have a key, at any level.

    A comment may contain the word, and a quoted key may spell it by escapes. The caller reads the
    campaign where the answer is True; to read every campaign would double the time of a report.
    """
    return key in data.campaign_text or "\\" in data.campaign_text


def recorded_inversion(data: "CampaignData") -> "Campaign | None":
    """Return the campaign of a file; None for a study, and where the text is damaged."""
    if data.attributes.get("purpose", INVERSION) != INVERSION:
        return None
    # Imported here: most files are reported without what reads a campaign's text.
    from agglom_mpi.config.yaml_source import CampaignError

    try:
        return recorded_campaign(data)
    except CampaignError:
        data.note_altered(["campaign"])
        return None


@kept
def recorded_box(data: "CampaignData") -> VariableTable:
    """Return the variables of a campaign file with their ranges, as its rows have them."""
    rows, identity = data.variable_rows(), data.identity
    ranges = {}
    for variable, row in zip(data.variables.variables, rows, strict=True):
        scale = LOGARITHMIC if identity.get(f"variables.{variable.name}.2") == LOGARITHMIC else ""
        lower, upper = float(row["lower"]), float(row["upper"])
        ranges[variable.name] = variable._replace(lower=lower, upper=upper, scale=scale)
    return data.variables.with_ranges(ranges)


def searched_variables(data: "CampaignData") -> tuple[Variable, ...]:
    """Return the variables that are searched, with their ranges in SI units.

    The volume fraction is in place of the size ratio where the campaign gives it.
    """
    if any(column.name == VOLUME_FRACTION.name for column in derived_columns(data)):
        return recorded_campaign(data).variables.own
    return recorded_box(data).own


@kept
def derived_columns(data: "CampaignData") -> list[DerivedColumn]:
    """Return the derived columns of all strings of a campaign file, in the order of its rows.

    There are none where its text is damaged, or has code of one's own that may not run.
    """
    if code_note(data) or not any(may_have_key(data, key) for key in DERIVING_KEYS):
        return []
    campaign = recorded_inversion(data)
    if campaign is None:
        return []
    return columns_of(campaign, parameters_of(data.string_rows()))


def values_of(data: "CampaignData", strings: Sequence[int] | Floats, name: str) -> Floats:
    """Return a variable or derived column of strings, (n,), in SI units; nan where there is none.

    Parameters
    ----------
    data
    strings
        Their numbers, (n,).
    name
        Of the variable or column.
    """
    known = {column.name: column for column in derived_columns(data)}
    if name not in known:
        return data.values(strings, name)
    numbers = data.string_rows()["string"].tolist()
    values = dict(zip(numbers, known[name].values.tolist(), strict=True))
    return np.array([values.get(int(string), np.nan) for string in strings])
