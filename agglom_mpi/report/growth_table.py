"""Growth at imposed relative speeds as a table for the terminal and as JSON."""

from typing import Any, Final

from rich.console import Group, RenderableType

from agglom_mpi.analysis.imposed_speeds import ImposedGrowth
from agglom_mpi.display.table import Column, Table

GROWTH_COLUMNS: Final = (
    Column("time", unit="s", format=".3g"),
    Column("mean_mass", "mean mass (grains)", format=".4g"),
    Column("mass_band", "2 errors"),
    Column("particles", "particles left", format=".3g"),
    Column("particle_band", "2 errors"),
    Column("extrapolated", format=".1%"),
)


def growth_text(growth: ImposedGrowth, grain_mass: float) -> RenderableType:
    """Return growth as a table, and the size from which few impacts stick; `grain_mass` in kg."""
    rows = [
        record
        | {
            "mean_mass": record["mean_mass"] / grain_mass,
            "mass_band": _band(record, "mean_mass", grain_mass),
            "particle_band": _band(record, "particles", 1.0),
        }
        for record in growth_records(growth)
    ]
    grains, (mean, scatter) = growth.barrier / grain_mass, growth.efficiency
    barrier = "at all sizes or none more than half of the impacts of equal particles stick"
    if grains > 0.0:
        barrier = (
            f"fewer than half of the impacts of equal particles stick from {grains:.3g} grains, "
            f"{grains ** (1.0 / 3.0):.3g} times their radius"
        )
    title = "Growth at the imposed relative speeds, by the Smoluchowski equations"
    notes = [
        barrier,
        "mean mass: weighted by mass; extrapolated: share of the mass in particles larger than "
        f"those whose collisions were counted, with the mean efficiency, {mean:.3f}, and the "
        f"scatter of pairs, {scatter:.3f}, as its error",
    ]
    return Group("", Table(GROWTH_COLUMNS, rows, title), *notes)


def _band(record: dict[str, Any], name: str, unit: float) -> str:
    return "–".join(f"{record[f'{name}_{end}'] / unit:.3g}" for end in ("from", "to"))


def growth_records(growth: ImposedGrowth) -> list[dict[str, Any]]:
    """Return a record for each time, in SI units; `…_from` and `…_to` are two errors away."""
    records = []
    for k, time in enumerate(growth.times.tolist()):
        record = {"time": time, "extrapolated": float(growth.extrapolated[k])}
        for name in ("mean_mass", "particles"):
            low, value, high = sorted(getattr(growth, name)[:, k].tolist())
            record |= {name: value, f"{name}_from": low, f"{name}_to": high}
        records.append(record)
    return records


def growth_json(growth: ImposedGrowth) -> dict[str, Any]:
    """Return growth as data of JSON, in SI units; no barrier is null."""
    barrier = growth.barrier if growth.barrier > 0.0 else None
    efficiency = {"mean": growth.efficiency[0], "scatter": growth.efficiency[1]}
    return {"barrier": barrier, "efficiency": efficiency, "growth": growth_records(growth)}
