"""Expressions: trees of arithmetic on quantities, their dimensions, values and texts.

A dimension is the powers of the base dimensions, which pint knows of units. Expressions are
evaluated in float64 on arrays, elementwise; see `expression_reader` for how they are read.
"""

import math
import operator
from collections.abc import Callable, Iterator, Mapping
from fractions import Fraction
from functools import cache
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from agglom_mpi.declaration.spelling import suggestion
from agglom_mpi.declaration.units import KINDS, dimensions_of

Floats = NDArray[np.float64]

Dimension = tuple[tuple[str, Fraction], ...]
"""Base dimensions with their powers other than 0, in alphabetical order."""

PURE: Final[Dimension] = ()
"""The dimension of a pure number."""

MAX_DENOMINATOR: Final = 1000
"""Largest denominator of a simple power, so that the cube of a third power is the first."""

BASE_UNITS: Final = {
    "[mass]": "kg",
    "[length]": "m",
    "[time]": "s",
    "[current]": "A",
    "[temperature]": "K",
    "[substance]": "mol",
    "[luminosity]": "cd",
}
"""SI units of the base dimensions, in the order in which they are written."""


def _dimension(powers: Mapping[str, Fraction]) -> Dimension:
    return tuple(sorted((name, power) for name, power in powers.items() if power != 0))


def dimension_of(unit: str) -> Dimension:
    """Return the dimension of a unit; raise a ValueError if there is no such unit."""
    powers = dimensions_of(unit).items()
    return _dimension({name: _fraction(power) for name, power in powers})


def _fraction(power: float) -> Fraction:
    """Return a power as a fraction: a simple one only if it is the same in float64."""
    simple = Fraction(power).limit_denominator(MAX_DENOMINATOR)
    return simple if math.isclose(simple, power, rel_tol=1e-14) else Fraction(repr(float(power)))


def product(left: Dimension, right: Dimension) -> Dimension:
    """Return the dimension of a product."""
    powers = dict(left)
    for name, power in right:
        powers[name] = powers.get(name, Fraction(0)) + power
    return _dimension(powers)


def power(dimension: Dimension, exponent: float) -> Dimension:
    """Return the dimension of a power."""
    return _dimension({name: each * _fraction(exponent) for name, each in dimension})


@cache
def _known() -> dict[Dimension, tuple[str, str]]:
    """Return unit and kind by dimension; the first of several with the same."""
    known: dict[Dimension, tuple[str, str]] = {}
    for unit, kind in KINDS.items():
        known.setdefault(dimension_of(unit), (unit, kind))
    return known


def kind_of(dimension: Dimension) -> str:
    """Return the name of a dimension for a message: `pressure`, or its unit."""
    if dimension in _known():
        return _known()[dimension][1]
    return f"a quantity in {unit_of(dimension)}"


def unit_of(dimension: Dimension) -> str:
    """Return the SI unit of a dimension in ASCII: `Pa`, `kg/m/s^3`."""
    if dimension in _known():
        return _known()[dimension][0]
    powers = dict(dimension)
    order = [*BASE_UNITS, *(name for name in powers if name not in BASE_UNITS)]
    factors = [
        (BASE_UNITS.get(name, name.strip("[]")), powers[name]) for name in order if name in powers
    ]
    above = [_factor(unit, power) for unit, power in factors if power > 0]
    below = [_factor(unit, -power) for unit, power in factors if power < 0]
    return "/".join(["*".join(above) or "1", *below])


def _factor(unit: str, power: Fraction) -> str:
    if power == 1:
        return unit
    return f"{unit}^{power}" if power.denominator == 1 else f"{unit}^({power})"


MAX_EXPONENT: Final = 100.0
"""Largest magnitude of an exponent."""


class Number(NamedTuple):
    """A number in SI units, with its text.

    Attributes
    ----------
    value, dimension, text
    offset
        Whether its unit has an offset, as degC, so that it is compared but not computed with.
    """

    value: float
    dimension: Dimension
    text: str
    offset: bool = False


class Name(NamedTuple):
    """A quantity by its name."""

    name: str


class Operation(NamedTuple):
    """Two operands with an operator of `OPERATORS`, or the negative of one."""

    operator: str
    operands: "tuple[Node, ...]"


Node = Number | Name | Operation

OPERATORS: Final[dict[str, Callable[[Any, Any], Any]]] = {
    "+": np.add,
    "-": np.subtract,
    "*": np.multiply,
    "/": np.divide,
    "**": np.power,
}
COMPARISONS: Final[dict[str, Callable[[Any, Any], Any]]] = {
    "<": operator.lt,
    "<=": operator.le,
    ">": operator.gt,
    ">=": operator.ge,
}


class Comparison(NamedTuple):
    """Operands, each compared with the next by an operator of `COMPARISONS`."""

    text: str
    operands: tuple[Node, ...]
    operators: tuple[str, ...]


def nodes_of(*nodes: Node) -> Iterator[Node]:
    """Yield all nodes of some trees."""
    for node in nodes:
        yield node
        yield from nodes_of(*node.operands) if isinstance(node, Operation) else ()


def names_in(*nodes: Node) -> Iterator[str]:
    """Yield the names in some trees, repeated ones too."""
    return (each.name for each in nodes_of(*nodes) if isinstance(each, Name))


def text_of(node: Node, definitions: Mapping[str, str]) -> str:
    """Return a tree as text in SI units with all brackets, the same for all its spellings.

    Parameters
    ----------
    node
    definitions
        Texts that stand for names.
    """
    match node:
        case Number(value=value):
            return definitions.get(repr(value), repr(value))
        case Name(name=name):
            return definitions.get(name, name)
        case Operation(operator=symbol, operands=operands):
            *left, right = (text_of(each, definitions) for each in operands)
            return f"({left[0]} {symbol} {right})" if left else f"(-{right})"


def shown(node: Node) -> str:
    """Return a tree as text for messages, with the numbers as they are written."""
    written = {repr(n.value): n.text for n in nodes_of(node) if isinstance(n, Number)}
    text = text_of(node, written)
    return text[1:-1] if isinstance(node, Operation) else text


def evaluate(node: Node, values: Mapping[str, Any]) -> Any:
    """Return the value of a tree in SI units, a float64 number or array as broadcast.

    Parameters
    ----------
    node
    values
        Numbers or arrays by name. Nothing raises: a quotient by 0 is inf or nan.
    """
    match node:
        case Number(value=value):
            return np.float64(value)
        case Name(name=name):
            return np.asarray(values[name], np.float64)
        case Operation(operator=symbol, operands=operands):
            *left, right = (evaluate(each, values) for each in operands)
            with np.errstate(all="ignore"):
                return OPERATORS[symbol](left[0], right) if left else -right


def satisfied(comparison: Comparison, values: Mapping[str, Any]) -> Any:
    """Return whether all comparisons hold, elementwise; nan satisfies none."""
    operands = [evaluate(node, values) for node in comparison.operands]
    holds: Any = True
    for symbol, left, right in zip(comparison.operators, operands, operands[1:], strict=False):
        holds = np.logical_and(holds, COMPARISONS[symbol](left, right))
    return holds


def dimension(node: Node, known: Mapping[str, Dimension]) -> Dimension | None:
    """Return the dimension of a tree; None of a 0, which has any.

    Parameters
    ----------
    node
    known
        Dimensions by name.

    Raises
    ------
    ValueError
        If a name is unknown, or the dimensions do not fit together.
    """
    match node:
        case Number(value=value, dimension=own):
            return None if value == 0.0 and own == PURE else own
        case Name(name=name):
            if name not in known:
                raise ValueError(f"has the unknown name '{name[:40]}'; {suggestion(name, known)}")
            return known[name]
        case Operation(operator="**"):
            return _dimension_of_power(node, known)
        case Operation(operator="+" | "-", operands=operands):
            return common_dimension(operands, known, f"in '{shown(node)}'")
        case Operation(operator=symbol, operands=operands):
            above, below = (dimension(each, known) for each in operands)
            if symbol == "/" and below is None:
                raise ValueError(f"divides by 0 in '{shown(node)}'")
            if above is None or below is None:
                return None
            return product(above, below if symbol == "*" else power(below, -1.0))


def common_dimension(
    nodes: tuple[Node, ...], known: Mapping[str, Dimension], where: str
) -> Dimension | None:
    """Return the dimension that all these have; raise a ValueError if they differ."""
    found, first = None, nodes[0]
    for node in nodes:
        own = dimension(node, known)
        if found is None:
            found, first = own, node
        elif own is not None and own != found:
            kinds = [f"'{shown(n)}' is {kind_of(d)}" for n, d in ((first, found), (node, own))]
            hint = "; write a number with its unit, like '10 MPa'" if PURE in (found, own) else ""
            raise ValueError(f"does not fit together {where}: {', '.join(kinds)}{hint}")
    return found


def _dimension_of_power(node: Operation, known: Mapping[str, Dimension]) -> Dimension | None:
    below, exponent = node.operands
    if any(names_in(exponent)) or dimension(exponent, known) not in (PURE, None):
        raise ValueError(f"has an exponent that is no plain number in '{shown(node)}'")
    value = float(evaluate(exponent, {}))
    if not abs(value) <= MAX_EXPONENT:
        raise ValueError(
            f"has the exponent {value:g} in '{shown(node)}'; at most {MAX_EXPONENT:g} in size"
        )
    base = dimension(below, known)
    return None if base is None else power(base, value)
