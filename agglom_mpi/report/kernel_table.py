"""Kernels of a string as a table for the terminal, as JSON, CSV and NetCDF."""

import csv
import json
import math
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any, Final, NamedTuple

import numpy as np
import numpy.typing as npt
from rich.console import Group, RenderableType
from scipy.io import netcdf_file

from agglom_mpi.analysis.collision_kernels import COEFFICIENTS, Coefficient, CollisionKernels
from agglom_mpi.analysis.counted_samples import collision_kernels
from agglom_mpi.analysis.imposed_speeds import (
    ImposedGrowth,
    imposed_growth,
    power_law,
    require_unbreakable,
)
from agglom_mpi.analysis.merged_pairs import pooled
from agglom_mpi.display.table import Column, Table
from agglom_mpi.formatting import in_unit
from agglom_mpi.report.growth_table import growth_json
from agglom_mpi.report.simulate import SimulationRequest, selected_string
from agglom_mpi.simulation.collision_counts import ENERGY, NUMBER
from agglom_mpi.storage.files import atomic_file, require_absent

UNITS: Final = {
    **{"from": "s", "to": "s", "rate": "m^3/s", "loss": "J"},
    **{"energy": "J", "energy_by_equations": "J"},
    **{"speed": "m/s", "squared_speed": "m^2/s^2"},
    **{f"{one}_mass": "kg" for one in ("first", "second", "broken", "piece")},
    **{f"{one}_temperature": "J" for one in ("first", "second")},
}
"""Units of what has one."""

SHOWN: Final = 40
"""Most pairs that the terminal shows, those with the most collisions."""

COLUMNS: Final = (
    Column("pair", "masses (grains)"),
    Column("window", unit="s"),
    Column("collisions", format=",d"),
    Column("merged_collisions", "merged", format=",d"),
    *(Column(name, unit=UNITS.get(name, "")) for name in COEFFICIENTS if name != "squared_speed"),
    Column("sticking_by_law", format=".3g"),
)

PIECE_COLUMNS: Final = (
    Column("broken", "broken (grains)"),
    Column("piece", "piece (grains)"),
    Column("window", unit="s"),
    Column("pieces", format=",d"),
    Column("share"),
)

BALANCE_COLUMNS: Final = (
    Column("window", unit="s"),
    Column("particles"),
    Column("particles_by_equations", "by equations", format=".4g"),
    Column("energy", "kinetic energy", unit="J"),
    Column("energy_by_equations", "by equations", unit="J", format=".4g"),
)

MAX_GROWTH: Final = 2.0
"""Maximum growth of the mean mass in a window; see the figures in `analysis/README.md`."""


class KernelRequest(NamedTuple):
    """Options of `agglom kernels`, as `cli/kernels.py` declares them."""

    source: Path
    settings: dict[str, float | str]
    string: int | None
    samples: int
    bins: int
    times: tuple[float, ...]
    error: float
    csv: Path | None
    netcdf: Path | None
    allow_code: bool
    impose: tuple[float, float, float] | None = None
    """Imposed relative speed of two mean grains in m/s, its exponent in the radius, time in s."""


def string_kernels(request: KernelRequest, show: Callable[[str], None]) -> CollisionKernels:
    """Count the collisions of a string, and write its tables if asked for.

    `show` is called with warnings.

    Raises
    ------
    CampaignError
        If the campaign, an option or a variable is wrong.
    FileExistsError
        If there is a file of a table's name already.
    """
    writers = ((request.csv, write_kernels), (request.netcdf, write_netcdf))
    for path, _ in writers:
        if path is not None:
            require_absent(path)
    options = request.source, request.settings, request.samples, None, request.string, None
    campaign, vector, first, *_ = selected_string(
        SimulationRequest(*options, request.allow_code), show
    )
    if request.impose is not None:
        require_unbreakable(campaign.impact_tests_at(vector))
    counted = request.samples, request.bins, request.times, first
    found = replace(collision_kernels(campaign, vector, *counted), max_error=request.error)
    for path, write in writers:
        if path is not None:
            write(found, path)
    for line in _fast_growth(found):
        show(f"warning: {line}")
    return found


def _fast_growth(found: CollisionKernels) -> list[str]:
    """Return a line if the mean mass grows too much in a window for the equations."""
    if found.breaks or (growth := float(found.growth.max())) <= MAX_GROWTH:
        return []
    w = int(np.argmax(found.growth))
    return [
        f"the mean mass grows {growth:.2g} times from {found.times[w]:.3g} to "
        f"{found.times[w + 1]:.3g} s, and kernels are means over this window; beyond "
        f"{MAX_GROWTH:g} times in a window, rates and equations have errors of several percent; "
        f"divide it by --time into at least {math.ceil(math.log(growth, MAX_GROWTH))} windows"
    ]


def string_growth(request: KernelRequest, found: CollisionKernels) -> ImposedGrowth | None:
    """Return the growth at the imposed speeds, if there are any."""
    if request.impose is None:
        return None
    *law, until = request.impose
    return imposed_growth(found, power_law(found.grain_mass, *law), until)


def kernel_text(found: CollisionKernels) -> RenderableType:
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
    string = [f"{n} {in_unit(f'{v:.6g}', unit)}" for n, (v, unit) in found.parameters.items()]
    notes = [
        f"string: {', '.join(string)}",
        f"{int(found.sums.samples.sum())} samples, {found.failed} failed",
        "efficiency: the rate over that of Maxwellian grains with the same partial temperatures; "
        "speed: normal to the contact; sticking by law: of Maxwellian grains",
        "merged: collisions of all pairs of bins that share a coefficient, so that the error of "
        f"the efficiency is at most {100.0 * found.max_error:g} %; other pairs are left out",
    ]
    if len(most) < len(records):
        notes.append(f"{len(records) - len(most)} more pairs: --csv and --json have all")
    return Group(Table(COLUMNS, rows), *notes, *_piece_text(found), *_balance_text(found))


def _window(record: dict[str, Any]) -> str:
    return f"{record['from']:.3g}–{record['to']:.3g}"


def _piece_text(found: CollisionKernels) -> list[RenderableType]:
    rows = [
        record
        | {name: f"{record[f'{name}_mass'] / found.grain_mass:.3g}" for name in ("broken", "piece")}
        | {"window": _window(record)}
        for record in found.piece_records()
    ]
    title = "Pieces of broken particles, by number"
    return ["", Table(PIECE_COLUMNS, rows, title)] if rows else []


def _balance_text(found: CollisionKernels) -> list[RenderableType]:
    try:
        records = balance_records(found)
    except RuntimeError as error:
        return ["", f"{error}; divide the time by --time"]
    if not records:
        return []
    rows = [record | {"window": _window(record)} for record in records]
    title = "Means of a sample, simulated and by the Smoluchowski equations with these kernels"
    return ["", Table(BALANCE_COLUMNS, rows, title)]


def balance_records(found: CollisionKernels) -> list[dict[str, Any]]:
    """Return a record for each window of a string; none if particles break.

    Means of a sample are pairs of value and standard error. Raises a RuntimeError if the equations
    cannot be integrated.
    """
    if found.breaks:
        return []
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
    pieces = [_separate(record) for record in found.piece_records()]
    failed = {}
    try:
        balance = balance_records(found)
    except RuntimeError as error:
        balance, failed = [], {"balance_error": str(error)}
    values = {name: value for name, (value, _) in found.parameters.items()}
    shown: dict[str, Any] = {
        "parameters": values,
        "samples": int(found.sums.samples.sum()),
        "failed": found.failed,
    }
    shown |= {"units": UNITS, "kernels": records, "pieces": pieces}
    shown |= {"balance": [_separate(record) for record in balance]} | failed
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


PAIRS: Final = ("window", "bin", "other_bin")
"""Dimensions of arrays of pairs."""


def write_netcdf(found: CollisionKernels, path: Path) -> None:
    """Write all arrays as NetCDF-3, with units; pairs in both orders, nan without a coefficient."""
    bins, windows = len(found.masses), len(found.times) - 1
    lengths = {"bin": bins, "other_bin": bins, "piece_bin": bins}
    lengths |= {"window": windows, "edge": windows + 1}
    with atomic_file(path) as temporary, netcdf_file(temporary, "w") as file:
        for name, length in lengths.items():
            file.createDimension(name, length)
        for name, (dimensions, unit, values) in _arrays(found).items():
            variable = file.createVariable(name, "d", dimensions)
            variable[...] = _in_both_orders(values) if dimensions == PAIRS else values
            variable.units = unit or "1"


def _arrays(found: CollisionKernels) -> dict[str, tuple[tuple[str, ...], str, Any]]:
    """Return dimensions, unit and values of each array of a NetCDF file."""
    samples = found.sums.samples.sum()
    start, numbers = found.sums.start.sum(axis=0) / samples, ("window", "bin")
    arrays: dict[str, tuple[tuple[str, ...], str, Any]] = {
        "time": (("edge",), "s", found.times),
        "mass": (("bin",), "kg", found.masses),
        "start_particles": (("bin",), "", start[:, NUMBER]),
        "start_energy": (("bin",), "J", start[:, ENERGY]),
        "particles": (numbers, "", found.numbers),
        "temperature": (numbers, "J", found.temperatures),
        "collisions": (PAIRS, "", found.hits),
        "merged_collisions": (PAIRS, "", pooled(found.hits, found.groups)),
        "sticking_by_law": (PAIRS, "", found.sticking_by_law),
        "volume": ((), "m^3", found.volume),
        "density": ((), "kg/m^3", found.density),
        "samples": ((), "", samples),
    }
    measured: dict[str, tuple[tuple[str, ...], Coefficient]] = {
        name: (PAIRS, getattr(found, name)) for name in COEFFICIENTS
    }
    measured["pieces"] = ("window", "bin", "piece_bin"), found.pieces
    for k, name in enumerate(("particles", "energy")):
        measured[f"mean_{name}"] = ("window",), Coefficient(*(each[:, k] for each in found.means))
    for name, (dimensions, values) in measured.items():
        unit = UNITS.get(name.removeprefix("mean_"), "")
        arrays |= {name: (dimensions, unit, values.value)}
        arrays |= {f"{name}_error": (dimensions, unit, values.error)}
    return arrays


def _in_both_orders(values: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
    """Return values of pairs of bins, whose upper triangle is given, as a symmetric matrix."""
    lower = np.tri(values.shape[-1], k=-1, dtype=bool)
    return np.where(lower, np.swapaxes(values, -1, -2), values)


def _separate(record: dict[str, Any]) -> dict[str, Any]:
    """Return a record with values and errors as numbers of their own."""
    found: dict[str, Any] = {}
    for name, value in record.items():
        if isinstance(value, tuple):
            found[name], found[f"{name}_error"] = value
        else:
            found[name] = float(value) if not isinstance(value, int) else value
    return found
