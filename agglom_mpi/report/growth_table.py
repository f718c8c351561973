"""Growth at imposed relative speeds as a table for the terminal and as JSON."""

from typing import Any, Final

import numpy as np
from rich.console import Group, RenderableType

from agglom_mpi.analysis.imposed_speeds import ImposedGrowth
from agglom_mpi.display.table import Column, Table
from agglom_mpi.formatting import format_percent, number_or_none

GROWTH_COLUMNS: Final = (
    Column("time", unit="s", format=".3g"),
    Column("mean_mass", "mean mass (grains)", format=".4g"),
    Column("band", "2 errors"),
    Column("extrapolated", format=".1%"),
)


def growth_text(growth: ImposedGrowth, grain_mass: float) -> RenderableType:
    """Return growth as a table, and the size from which few impacts stick; `grain_mass` in kg."""
    rows = []
    for record in growth_json(growth)["growth"]:
        low, mean, high = (record[f"mean_mass{end}"] / grain_mass for end in ("_from", "", "_to"))
        rows.append(record | {"mean_mass": mean, "band": f"{low:.3g}–{high:.3g}"})
    (mean, scatter), size = growth.efficiency, (growth.barrier / grain_mass) ** (1.0 / 3.0)
    grains = float(np.interp(grain_mass, growth.masses, growth.sticking))
    barrier = (
        f"barrier: {number_or_none(size, '.3g')}, in radii of a grain; from there on fewer than "
        f"half of the impacts of equal particles stick, and {format_percent(grains, 2)} of those "
        "of grains"
    )
    title = "Growth at the imposed relative speeds, by the Smoluchowski equations"
    note = (
        "mean mass: weighted by mass; extrapolated: share of the mass in particles larger than "
        f"those counted, with the mean efficiency {mean:.3f} and the scatter of pairs {scatter:.3f}"
    )
    return Group("", Table(GROWTH_COLUMNS, rows, title), barrier, note)


def growth_json(growth: ImposedGrowth) -> dict[str, Any]:
    """Return growth as data of JSON, in SI units; `…_from` and `…_to` are two errors away."""
    records = []
    for k, time in enumerate(growth.times.tolist()):
        record = {"time": time, "extrapolated": float(growth.extrapolated[k])}
        for name in ("mean_mass", "particles"):
            low, value, high = sorted(getattr(growth, name)[:, k].tolist())
            record |= {name: value, f"{name}_from": low, f"{name}_to": high}
        records.append(record)
    barrier = growth.barrier if growth.barrier > 0.0 else None
    efficiency, scatter = growth.efficiency
    shown: dict[str, Any] = {
        "barrier": barrier,
        "efficiency": efficiency,
        "efficiency_scatter": scatter,
    }
    masses = zip(growth.masses.tolist(), growth.sticking.tolist(), strict=True)
    shown["sticking"] = [{"mass": mass, "of_equal_masses": share} for mass, share in masses]
    return shown | {"growth": records}
