"""Columns of `/samples` with the censuses of a sample, and the attribute that describes them."""

import json
import math
from collections.abc import Mapping
from typing import Any, Final

from agglom_mpi.measurements.layout import (
    COUNTS,
    LARGEST,
    MASSES,
    TEMPERATURES,
    CensusLayout,
)
from agglom_mpi.storage.columns import Column

CENSUS: Final = "census"
"""Attribute with times and classes of the censuses of a file; absent without any."""

MAX_CLASSES: Final = 100_000
"""Maximum number of times and classes that an attribute may name."""


def census_columns(layout: CensusLayout | None) -> tuple[Column, ...]:
    """Return the columns of the censuses of a sample; none without a layout."""
    if layout is None:
        return ()
    times, shape = (len(layout.times),), (len(layout.times), layout.classes)
    where = "by time and class; see the attribute census; 0 if it failed"
    return (
        Column(COUNTS, "u4", "1", f"particles, {where}", shape, since=5),
        Column(MASSES, "f8", "kg", f"their mass, {where}", shape, since=5),
        Column(LARGEST, "f8", "kg", "mass of the largest particle, by time", times, since=5),
        Column(TEMPERATURES, "f8", "K", "mass-weighted mean temperature, by time", times, since=5),
    )


def census_attributes(layout: CensusLayout | None) -> dict[str, str]:
    """Return the attribute with the layout of the censuses of a file; none without any.

    Times are in s, null stands for the end of a sample; `edges` are diameters over twice b0.
    """
    if layout is None:
        return {}
    times = [time if math.isfinite(time) else None for time in layout.times]
    entries = {"times": times, "lower": layout.lower, "classes": layout.classes}
    return {CENSUS: json.dumps(entries | {"edges": layout.edges.tolist()})}


def census_of(attributes: Mapping[str, Any]) -> CensusLayout | None:
    """Return the layout of the censuses of a file; None without any.

    Raises
    ------
    ValueError
        If the attribute `census` is none that a run writes.
    """
    text = attributes.get(CENSUS, "")
    if not text:
        return None
    try:
        entries = json.loads(text)
        times = tuple(math.inf if time is None else float(time) for time in entries["times"])
        layout = CensusLayout(times, float(entries["lower"]), int(entries["classes"]))
    except (KeyError, TypeError, ValueError):
        raise ValueError("attribute census is no JSON object of times and classes") from None
    whole = 0 < layout.classes <= MAX_CLASSES and 0 < len(times) <= MAX_CLASSES
    if not whole or not math.isfinite(layout.lower) or list(times) != sorted(set(times)):
        raise ValueError("attribute census has impossible times or classes")
    return layout
