"""Values of the variables as a file gives them: one by one, and as strings to begin with.

Of some keys, a section has exactly one.
"""

from collections.abc import Mapping
from typing import Annotated, Any, Final

from agglom_mpi.declaration.components import Whole
from agglom_mpi.declaration.declared import (
    Declared,
    FieldPath,
    Meaning,
    NotEmpty,
    Reads,
    raise_field_errors,
)
from agglom_mpi.declaration.reading import Reading
from agglom_mpi.declaration.spelling import suggestion
from agglom_mpi.declaration.units import quoted, to_si
from agglom_mpi.formatting import in_unit
from agglom_mpi.variables import (
    TEN,
    VOLUME_FRACTION,
    Limits,
    Variable,
    VariableTable,
    size_ratio,
)

JAMMING_FRACTION: Final = 0.38
"""Volume fraction at which random sequential placement jams."""

MAX_SIZE_RATIO: Final = 0.8986
"""(6 JAMMING_FRACTION / pi)^(1/3), rounded down to four digits for messages."""

LIMITS: Final = {
    **dict.fromkeys(
        ("relative_speed", "friction", "activation_energy", "reaction_heat"), Limits(at_least=0.0)
    ),
    "size_ratio": Limits(above=0.0, at_most=MAX_SIZE_RATIO),
    "volume_fraction": Limits(above=0.0, at_most=JAMMING_FRACTION),
}
"""Limits of variables of the papers that are not merely greater than 0."""


def read_value(variable: Variable, value: Any) -> float:
    """Return one value of a variable in SI units; raise a ValueError if it is impossible."""
    number = to_si(value, variable.unit)
    name = variable.name.rpartition(".")[2]  # without that of an experiment
    limits = variable.limits or LIMITS.get(name, Limits(above=0.0))
    if broken := limits.broken_by(number):
        jams = name in FRACTIONS and number > 0.0
        why = f"; random placement jams near a volume fraction of {JAMMING_FRACTION}" * jams
        raise ValueError(f"is {quoted(value)}; must be {in_unit(broken, variable.unit)}{why}")
    return number


def read_variable(name: str, value: Any, table: VariableTable = TEN) -> tuple[str, float]:
    """Return a variable's name and value in SI units.

    Parameters
    ----------
    name, value
        As a file gives them.
    table
        The variables of the campaign; a volume fraction that is none is read as a size ratio.

    Raises
    ------
    ValueError
        If the name is unknown or the value impossible.
    """
    component = component_of(name, table)
    if name != component:
        return component, size_ratio(read_value(VOLUME_FRACTION, value), table.third_moment)
    return name, read_value(table[name], value)


def component_of(name: str, table: VariableTable) -> str:
    """Return the variable of strings that a name stands for: the size ratio for a volume fraction.

    Raises
    ------
    ValueError
        If the name is unknown.
    """
    if name == VOLUME_FRACTION.name and name not in table:
        return "size_ratio"
    if name == "size_ratio" and VOLUME_FRACTION.name in table:
        raise ValueError("follows from the volume fraction, which this campaign gives, and sizes")
    if name not in table:
        known = dict.fromkeys([*table.names, VOLUME_FRACTION.name])
        raise ValueError(f"unknown variable; {suggestion(name, known)}")
    return name


SIZES: Final = ("half_width", "grain_diameter", "grain_radius")
"""Keys of a scene for its size; one of them is given."""


FRACTIONS: Final = ("size_ratio", "volume_fraction")
"""Keys of the variables for the filling of the box; one of them is given."""


def one_of(
    keys: tuple[str, ...], values: Mapping[Any, Any], other: str = ""
) -> tuple[dict[Any, Any], list[tuple[FieldPath, str]]]:
    """Return values with one of these keys at most, and problems of the others.

    None of them is kept where `other` stands in their place.
    """
    given = [key for key in keys if key in values]
    surplus = given if other else given[1:]
    beside = other or "".join(given[:1])
    message = f"is given beside {beside}; give one of {', '.join(keys)}"
    kept = {key: value for key, value in values.items() if key not in surplus}
    return kept, [((key,), message) for key in surplus]


class EarlierCampaign(Declared):
    """The best strings of a campaign file, ranked by re-estimates where it has some.

    Attributes
    ----------
    file
        Name of the earlier campaign file, relative to the folder of this campaign.
    strings
        Number of best strings.
    """

    file: Annotated[NotEmpty, Meaning("a campaign file")]
    strings: Annotated[int, Whole(at_least=1, at_most=10**5)] = 1


def _read_strings(value: Any, reading: Reading) -> Any:
    """Return a list of strings, values by name in SI units, or an `EarlierCampaign`."""
    if isinstance(value, dict):
        return EarlierCampaign.checked(value)
    if not isinstance(value, list) or not value:
        raise ValueError(
            f"is {quoted(value)}; must be a list of strings like {{density: 6000}}, or "
            "{file: EARLIER.h5, strings: 6}"
        )
    problems, strings = list[tuple[FieldPath, str]](), []
    for i, string in enumerate(value):
        found: dict[str, float] = {}
        if not isinstance(string, dict):
            message = f"is {quoted(string)}; must be a mapping like {{density: 6000}}"
            problems.append(((i,), message))
            continue
        for name, given in string.items():
            try:
                found.update([read_variable(str(name), given, reading.variables)])
            except ValueError as error:
                problems.append(((i, str(name)), str(error)))
        strings.append(found)
    raise_field_errors(problems)
    return strings


GivenStrings = Annotated[
    list[dict[str, float]] | EarlierCampaign, Reads(_read_strings, in_context=True)
]
"""Strings to start with: values of searched variables, or the best of another campaign."""
