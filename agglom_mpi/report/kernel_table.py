"""Kernels of a string as a table for the terminal, as JSON and as CSV."""

import csv
import json
from collections.abc import Callable
from pathlib import Path
from typing import Any, Final, NamedTuple

from rich.console import Group, RenderableType

from agglom_mpi.analysis.collision_kernels import COEFFICIENTS, LEAST_HITS, CollisionKernels
from agglom_mpi.analysis.counted_samples import collision_kernels
from agglom_mpi.analysis.imposed_speeds import (
    ImposedGrowth,
    imposed_growth,
    power_law,
    require_unbreakable,
)
from agglom_mpi.display.table import Column, Table
from agglom_mpi.report.growth_table import growth_json, growth_text
from agglom_mpi.report.simulate import SimulationRequest, selected_string
from agglom_mpi.storage.files import atomic_file, require_absent

UNITS: Final = {
    **{"from": "s", "to": "s", "rate": "m^3/s", "loss": "J"},
    **{"energy": "J", "energy_by_equations": "J"},
    **{"speed": "m/s", "squared_speed": "m^2/s^2"},
    **{f"{one}_mass": "kg" for one in ("first", "second")},
    **{f"{one}_temperature": "J" for one in ("first", "second")},
}
"""Units of what has one."""

SHOWN: Final = 40
"""Most pairs that the terminal shows, those with the most collisions."""

COLUMNS: Final = (
    Column("pair", "masses (grains)"),
    Column("window", unit="s"),
    Column("collisions", format=",d"),
    *(Column(name, unit=UNITS.get(name, "")) for name in COEFFICIENTS if name != "squared_speed"),
    Column("sticking_by_law", format=".3g"),
)


BALANCE_COLUMNS: Final = (
    Column("window", unit="s"),
    Column("particles"),
    Column("particles_by_equations", "by equations", format=".4g"),
    Column("energy", "kinetic energy", unit="J"),
    Column("energy_by_equations", "by equations", unit="J", format=".4g"),
)


class KernelRequest(NamedTuple):
    """Options of `agglom kernels`, as `cli/kernels.py` declares them."""

    source: Path
    settings: dict[str, float | str]
    string: int | None
    samples: int
    bins: int
    times: tuple[float, ...]
    csv: Path | None
    allow_code: bool
    impose: tuple[float, float, float] | None = None
    """Imposed relative speed of two mean grains in m/s, its exponent in the radius, time in s."""


def string_kernels(request: KernelRequest, show: Callable[[str], None]) -> CollisionKernels:
    """Count the collisions of a string, and write its table if asked for.

    Raises
    ------
    CampaignError
        If the campaign, an option or a variable is wrong.
    FileExistsError
        If there is a file of the table's name already.
    """
    if request.csv is not None:
        require_absent(request.csv)
    options = request.source, request.settings, request.samples, None, request.string, None
    chosen = selected_string(SimulationRequest(*options, request.allow_code), show)
    if request.impose is not None:
        require_unbreakable(chosen[0].impact_tests_at(chosen[1]))
    found = collision_kernels(*chosen[:2], request.samples, request.bins, request.times)
    if request.csv is not None:
        write_kernels(found, request.csv)
    return found


def string_growth(request: KernelRequest, found: CollisionKernels) -> ImposedGrowth | None:
    """Return the growth at the imposed speeds, if there are any."""
    if request.impose is None:
        return None
    *law, until = request.impose
    return imposed_growth(found, power_law(found.grain_mass, *law), until)


def kernel_text(found: CollisionKernels, growth: ImposedGrowth | None = None) -> RenderableType:
    """Return the pairs with the most collisions as a table."""
    records, grain = found.records(), found.grain_mass
    most = sorted(range(len(records)), key=lambda k: -records[k]["collisions"])[:SHOWN]
    rows = [
        record
        | {
            "pair": f"{record['first_mass'] / grain:.3g}, {record['second_mass'] / grain:.3g}",
            "window": _window(record),
        }
        for record in map(records.__getitem__, sorted(most))
    ]
    notes = [
        f"{int(found.sums.samples.sum())} samples, {found.failed} failed",
        "efficiency: the rate over that of Maxwellian grains with the same partial temperatures; "
        "speed: normal to the contact; sticking by law: of Maxwellian grains",
        f"pairs of bins with fewer than {LEAST_HITS} collisions are left out",
    ]
    if len(most) < len(records):
        notes.append(f"{len(records) - len(most)} more pairs: --csv and --json have all")
    grown = [] if growth is None else [growth_text(growth, found.grain_mass)]
    return Group(Table(COLUMNS, rows), *notes, *_balance_text(found), *grown)


def _window(record: dict[str, Any]) -> str:
    return f"{record['from']:.3g}–{record['to']:.3g}"


def _balance_text(found: CollisionKernels) -> list[RenderableType]:
    if found.breaks:
        return []
    rows = [record | {"window": _window(record)} for record in balance_records(found)]
    title = "Means of a sample, simulated and by the Smoluchowski equations with these kernels"
    return ["", Table(BALANCE_COLUMNS, rows, title)]


def balance_records(found: CollisionKernels) -> list[dict[str, Any]]:
    """Return a record for each window of a string whose particles do not break.

    Means of a sample are pairs of value and standard error.
    """
    solved, (value, error) = found.balance(), found.means
    return [
        {
            "from": found.times[w],
            "to": found.times[w + 1],
            "particles": (value[w, 0], error[w, 0]),
            "particles_by_equations": solved[w, 0],
            "energy": (value[w, 1], error[w, 1]),
            "energy_by_equations": solved[w, 1],
        }
        for w in range(len(solved))
    ]


def kernel_json(found: CollisionKernels, growth: ImposedGrowth | None = None) -> str:
    """Return all pairs and the growth at imposed speeds as JSON, in SI units."""
    records = [_separate(record) for record in found.records()]
    balance = [] if found.breaks else balance_records(found)
    shown: dict[str, Any] = {"samples": int(found.sums.samples.sum()), "failed": found.failed}
    shown |= {"units": UNITS, "kernels": records}
    shown["balance"] = [_separate(record) for record in balance]
    if growth is not None:
        shown["imposed"] = growth_json(growth)
    return json.dumps(shown, indent=2, allow_nan=False)


def write_kernels(found: CollisionKernels, path: Path) -> None:
    """Write all pairs as CSV, with units in the headings."""
    records = [_separate(record) for record in found.records()]
    names = list(records[0]) if records else ["from", "to"]
    units = {name: UNITS.get(name.removesuffix("_error"), "") for name in names}
    headings = [f"{name} ({units[name]})" if units[name] else name for name in names]
    with atomic_file(path) as temporary, temporary.open("w", newline="") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(headings)
        writer.writerows([[record[name] for name in names] for record in records])


def _separate(record: dict[str, Any]) -> dict[str, Any]:
    """Return a record with values and errors as numbers of their own."""
    found: dict[str, Any] = {}
    for name, value in record.items():
        if isinstance(value, tuple):
            found[name], found[f"{name}_error"] = value
        else:
            found[name] = float(value) if not isinstance(value, int) else value
    return found
