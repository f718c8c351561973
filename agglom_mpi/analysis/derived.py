"""Derived columns of the strings of a campaign file."""

from collections.abc import Sequence
from typing import TYPE_CHECKING, Final

import numpy as np
from numpy.typing import NDArray

from agglom_mpi.config.derived import DerivedColumn, columns_of
from agglom_mpi.storage.reader import parameters_of
from agglom_mpi.storage.schema import INVERSION

if TYPE_CHECKING:
    from agglom_mpi.storage.reader import CampaignData

Floats = NDArray[np.float64]

WORDS: Final = ("derived", "volume_fraction", "grain_diameter", "grain_radius", "sizes")
"""Keys of which a campaign's text has one if it has derived columns."""


def derived_columns(data: "CampaignData") -> list[DerivedColumn]:
    """Return the derived columns of all strings of a campaign file, in the order of its rows.

    There are none where its text is damaged.
    """
    return data.derived(_columns)


def _columns(data: "CampaignData") -> list[DerivedColumn]:
    # Most campaigns have none, and need not be read for that.
    asked = any(word in data.campaign_text for word in WORDS)
    if not asked or data.attributes.get("purpose", INVERSION) != INVERSION:
        return []
    # Imported here: reading a file does not need what reads a campaign's text.
    from agglom_mpi.config.yaml_source import CampaignError
    from agglom_mpi.storage.recorded_campaign import recorded_campaign

    try:
        campaign = recorded_campaign(data)
    except CampaignError:
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
