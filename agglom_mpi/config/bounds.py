"""The `variables` section: values and ranges, and which variables a scene requires."""

from collections.abc import Mapping
from contextlib import suppress
from typing import Any, Final

from agglom_mpi.config.scene import SceneSection
from agglom_mpi.declaration.declared import FieldPath, problems_at, raise_field_errors
from agglom_mpi.declaration.given_values import FRACTIONS, one_of, read_value
from agglom_mpi.declaration.reading import Reading
from agglom_mpi.declaration.spelling import suggestion
from agglom_mpi.declaration.units import quoted, to_si, unit_in
from agglom_mpi.variables import (
    CUBIC,
    LOGARITHMIC,
    PAPER_VARIABLES,
    TEN,
    VOLUME_FRACTION,
    Variable,
    VariableTable,
    size_ratio,
)


def read_range(value: Any, variable: Variable, recorded: bool = False) -> Variable:
    """Return a variable with its entry: one value, or [lower, upper] or [lower, upper, log].

    In a `recorded` campaign one end alone may have a unit: the other one was read in SI units.
    """
    allowed = "one value, or a range [lower, upper] or [lower, upper, log]"
    if not isinstance(value, list | dict):
        number = read_value(variable, value)
        return variable._replace(lower=number, upper=number)
    logarithmic = len(value) == 3 and isinstance(value, list) and value[2] == LOGARITHMIC
    if isinstance(value, dict) or len(value) != 2 + logarithmic:
        numbers = [end for end in value if isinstance(end, int | float)]
        point = "; numbers have a decimal point, and no comma" * (len(numbers) == len(value) > 2)
        raise ValueError(f"is {quoted(value)}; must be {allowed}{point}")
    lower, upper = (read_value(variable, end) for end in value[:2])
    if not recorded:
        _check_units(value[:2], variable.unit)
    if lower >= upper:
        raise ValueError(f"is {quoted(value)}; the lower end must be less than the upper")
    if logarithmic and lower <= 0.0:
        raise ValueError(f"is {quoted(value)}; without 0, to be searched by its logarithm")
    scale = LOGARITHMIC if logarithmic else ""
    return variable._replace(lower=lower, upper=upper, scale=scale)


def _check_units(ends: list[Any], unit: str) -> None:
    """Raise a ValueError if one end alone has a unit, in which the other would be another value."""
    first, second = map(unit_in, ends)
    if bool(first) != bool(second):
        plain = ends[1] if first else ends[0]
        with suppress(ValueError):  # out of the limits of magnitudes
            if to_si(f"{plain} {first or second}", unit) == to_si(plain, unit):
                return
        raise ValueError(f"is {quoted(ends)}, with a unit on one end alone; write it on both")


def read_entries(value: Any, reading: Reading) -> dict[str, Variable | None]:
    """Return what the section gives of each variable of `reading` and of the volume fraction.

    Raises
    ------
    FieldError
        With all entries that are wrong.
    ValueError
        If the section is no mapping.
    """
    if not isinstance(value, Mapping):
        raise ValueError(f"is {quoted(value)}; must be a mapping")
    given, problems = one_of(FRACTIONS, value)
    known = (*PAPER_VARIABLES, VOLUME_FRACTION, *reading.variables.further)
    found: dict[str, Variable | None] = {variable.name: None for variable in known}
    for variable in known:
        if variable.name in given:
            try:
                entry = given[variable.name]
                found[variable.name] = read_range(entry, variable, reading.recorded)
            except ValueError as error:
                problems += problems_at(variable.name, error)
    for key in given:
        if key not in found:
            message = f"unknown key '{str(key)[:40]}'; {suggestion(str(key), found)}"
            problems.append(((str(key),), message))
    raise_field_errors(problems)
    return found


def ranges_of(
    entries: Mapping[str, Variable | None], table: VariableTable = TEN
) -> dict[str, Variable | None]:
    """Return the variables with their ranges by name, in their order.

    That of a volume fraction is one of the size ratio unless the fraction is a variable of its own.
    """
    ranges = {name: entries[name] for name in table.names}
    fraction = None if VOLUME_FRACTION.name in table else entries[VOLUME_FRACTION.name]
    if fraction is not None:
        linear = fraction.is_searched and not fraction.logarithmic
        ranges["size_ratio"] = TEN["size_ratio"]._replace(
            lower=size_ratio(fraction.lower, table.third_moment),
            upper=size_ratio(fraction.upper, table.third_moment),
            scale=CUBIC if linear else fraction.scale,
        )
    return ranges


def variables_of(
    entries: Mapping[str, Variable | None], scene: SceneSection, table: VariableTable = TEN
) -> VariableTable:
    """Return the variables of a campaign with the ranges that its scene depends on."""
    needed = required_variables(scene, table)
    given = {name: each for name, each in ranges_of(entries, table).items() if each is not None}
    return table.with_ranges(
        {name: each for name, each in given.items() if name in needed},
        ignored=tuple(name for name in given if name not in needed),
        by_volume_fraction=entries[VOLUME_FRACTION.name] is not None
        and VOLUME_FRACTION.name not in table,
        third_moment=table.third_moment,
    )


ABSENT: Final = {
    "hardness": "restitution by pressure",
    "heat_capacity": "heating",
    "friction": "friction",
    "temperature": "heating and no arrhenius hardness",
    "activation_energy": "arrhenius hardness",
    "reaction_heat": "reaction",
    "surface_energy": "fragmentation and no adhesion",
}
"""Submodels that are absent from a scene in which nothing depends on the variable."""


def required_variables(scene: SceneSection, table: VariableTable = TEN) -> dict[str, str]:
    """Return the variables that the scene depends on, in their order, with what requires each.

    All numbers of the scene that `table` has are among them.
    """
    reasons = dict.fromkeys(("relative_speed", "size_ratio", "density"), "every scene")
    if scene.restitution.uses_contact_pressure:
        reasons["hardness"] = f"restitution: {scene.restitution.name}"
    used = [each for each in scene.laws() if each.is_used]
    used.sort(key=lambda each: each.key != "heating")  # which other laws of heat need, too
    for key, law, _ in used:
        for name in law.required:
            reasons.setdefault(name, f"{key}: {law.name}")
    if VOLUME_FRACTION.name in table:
        del reasons["size_ratio"]
    reasons |= {variable.name: "scene" for variable in table.further}
    return {name: reasons[name] for name in table.names if name in reasons}


def check_required(
    scene: SceneSection, entries: Mapping[str, Variable | None], table: VariableTable = TEN
) -> list[tuple[FieldPath, str]]:
    """Return problems: variables that are missing, and ranges that nothing depends on."""
    needed = required_variables(scene, table)
    problems: list[tuple[FieldPath, str]] = []
    for name in TEN.names:
        entry = entries[name]
        if entry is None and name in needed:
            message = f"is missing; needed by {needed[name]}; a value or a range [lower, upper]"
            if name == "size_ratio":
                message += f", or {VOLUME_FRACTION.name} in its place"
            problems.append(((name,), message))
        elif entry is not None and entry.is_searched and name not in needed:
            message = (
                f"is a range, but the scene has no {ABSENT[name]}; nothing depends on it; "
                "give one value or leave it out"
            )
            problems.append(((name,), message))
    idle = {law.key for law in scene.laws() if not law.is_used}
    for variable in table.further:
        entry, key = entries[variable.name], variable.section
        if key in idle and entry is not None and entry.is_searched:
            message = "is a range, but nothing in the scene depends on it; leave it out"
            problems.append(((variable.name,), message))
    return problems
