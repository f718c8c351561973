"""Expressions: trees of arithmetic on quantities, their dimensions, values and texts.

They are evaluated in float64 on arrays, elementwise; see `expression_reader` for how they are read.
"""

import operator
from collections.abc import Callable, Iterator, Mapping
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from agglom_mpi.config.dimensions import PURE, Dimension, kind_of, power, product
from agglom_mpi.declaration.spelling import suggestion

Floats = NDArray[np.float64]

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


def nodes_of(node: Node) -> Iterator[Node]:
    """Yield all nodes of a tree."""
    yield node
    for operand in node.operands if isinstance(node, Operation) else ():
        yield from nodes_of(operand)


def names_in(node: Node) -> Iterator[str]:
    """Yield the names in a tree, repeated ones too."""
    return (each.name for each in nodes_of(node) if isinstance(each, Name))


def size_of(node: Node, sizes: Mapping[str, int]) -> int:
    """Return the number of nodes of a tree, a name counting as many as `sizes` says or 1."""
    return sum(sizes.get(each.name, 1) if isinstance(each, Name) else 1 for each in nodes_of(node))


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


class _Any:
    """The dimension of a 0, which has any."""


ANY: Final = _Any()


def dimension(node: Node, known: Mapping[str, Dimension]) -> Dimension | _Any:
    """Return the dimension of a tree, `ANY` of a 0.

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
            return ANY if value == 0.0 and own == PURE else own
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
            if symbol == "/" and below is ANY:
                raise ValueError(f"divides by 0 in '{shown(node)}'")
            if isinstance(above, _Any) or isinstance(below, _Any):
                return ANY
            return product(above, below if symbol == "*" else power(below, -1.0))


def common_dimension(
    nodes: tuple[Node, ...], known: Mapping[str, Dimension], where: str
) -> Dimension | _Any:
    """Return the dimension that all these have; raise a ValueError if they differ."""
    found: Dimension | _Any = ANY
    first = nodes[0]
    for node in nodes:
        own = dimension(node, known)
        if isinstance(own, _Any):
            continue
        if isinstance(found, _Any):
            found, first = own, node
        elif own != found:
            kinds = [f"'{shown(n)}' is {kind_of(d)}" for n, d in ((first, found), (node, own))]
            hint = "; write a number with its unit, like '10 MPa'" if PURE in (found, own) else ""
            raise ValueError(f"does not fit together {where}: {', '.join(kinds)}{hint}")
    return found


def _dimension_of_power(node: Operation, known: Mapping[str, Dimension]) -> Dimension | _Any:
    below, exponent = node.operands
    if any(names_in(exponent)) or dimension(exponent, known) not in (PURE, ANY):
        raise ValueError(f"has an exponent that is no plain number in '{shown(node)}'")
    value = float(evaluate(exponent, {}))
    if not abs(value) <= MAX_EXPONENT:
        raise ValueError(
            f"has the exponent {value:g} in '{shown(node)}'; at most {MAX_EXPONENT:g} in size"
        )
    base = dimension(below, known)
    return base if isinstance(base, _Any) else power(base, value)
