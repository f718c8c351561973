"""Reader of arithmetic in campaign files, whose syntax is Python's but which is never run as such.

Numbers may have units, `5 kW/m^3`; `^` is `**`. Texts and trees are limited in size.
"""

import ast
import math
import re
import sys
import warnings
from collections.abc import Collection, Container
from keyword import iskeyword
from typing import Final

from agglom_mpi.config.expressions import (
    PURE,
    Comparison,
    Name,
    Node,
    Number,
    Operation,
    dimension_of,
)
from agglom_mpi.declaration.spelling import remedy, with_plain_minus
from agglom_mpi.declaration.units import has_offset, in_base_units, quoted

MAX_CHARACTERS: Final = 500
"""Longest text of an expression."""
MAX_NODES: Final = 100
"""Largest number of numbers, names and operators of an expression."""

ALLOWED: Final = "allowed: + - * / **, brackets, names, and numbers like 0.1 or '5 kW/m^3'"

_BINARY: Final = {ast.Add: "+", ast.Sub: "-", ast.Mult: "*", ast.Div: "/", ast.Pow: "**"}
_COMPARED: Final = {ast.Lt: "<", ast.LtE: "<=", ast.Gt: ">", ast.GtE: ">="}


def read_expression(text: str, names: Collection[str], recorded: bool = False) -> Node:
    """Return the tree of an expression.

    Parameters
    ----------
    text
        Such as `0.5 * density * relative_speed**2`.
    names
        Names of quantities, which are not read as units; paths such as `sizes.spread` among them.
    recorded
        Whether a run recorded the text. Then 20 degC may stand in a sum, where it is 293.15 K.

    Raises
    ------
    ValueError
        If it is anything else, with what is allowed.
    """
    parsed, reader = _parse(text, names, recorded)
    if isinstance(parsed, ast.Compare):
        raise ValueError(f"is {quoted(text)}, a comparison; must be a quantity")
    return reader.node(parsed)


def read_comparison(text: str, names: Collection[str], recorded: bool = False) -> Comparison:
    """Return the operands of a constraint; arguments and errors as for `read_expression`."""
    parsed, reader = _parse(text, names, recorded)
    if not isinstance(parsed, ast.Compare) or not {*map(type, parsed.ops)} <= _COMPARED.keys():
        raise ValueError(f"is {quoted(text)}; must compare two quantities by <, <=, > or >=")
    operands = tuple(reader.node(each) for each in (parsed.left, *parsed.comparators))
    return Comparison(text, operands, tuple(_COMPARED[type(each)] for each in parsed.ops))


def _parse(text: str, names: Collection[str], recorded: bool) -> tuple[ast.expr, "_Reader"]:
    if len(text) > MAX_CHARACTERS:
        raise ValueError(f"has {len(text)} characters; must be at most {MAX_CHARACTERS}")
    if private := _PRIVATE.search(text):
        raise ValueError(f"has the name {quoted(private.group())}; names begin with a letter")
    if _DECIMAL_COMMA.search(text):
        raise ValueError(f"is {quoted(text)}{remedy(text)}")
    reader = _Reader(text, recorded)
    spelled = _FORTRAN.sub(r"\1e", with_plain_minus(text))
    pathless = _without_paths(spelled, names, reader)
    plain = _without_units(pathless, {*names, *reader.paths}, reader)
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            return ast.parse(plain.strip(), mode="eval").body, reader
    except (SyntaxError, ValueError, MemoryError, RecursionError):
        raise ValueError(f"is {quoted(text)}, which is no arithmetic; {ALLOWED}") from None


_WORD: Final = r"°?[^\W\d]\w*"
_POWER: Final = r"(?:\s*(?:\^|\*\*)\s*-?\d{1,2})?"
# Possessive, so that `1e999` is never read as 1 with the unit e999.
_DIGITS: Final = r"(?<![\w.])(?:\d++\.?+\d*+|\.\d++)"
_NUMBER: Final = rf"{_DIGITS}(?:[eE][+-]?\d++)?+"
_FORTRAN: Final = re.compile(rf"({_DIGITS})D(?=[+-]?\d)")
_QUANTITY: Final = re.compile(rf"({_NUMBER})\s*({_WORD}{_POWER}(?:\s*[*/]\s*{_WORD}{_POWER})*)")
_SEGMENT: Final = re.compile(rf"\s*[*/]?\s*({_WORD}){_POWER}")
_DECIMAL_COMMA: Final = re.compile(r"\d,\d")
_PLACEHOLDER: Final = "_"
_EXPONENT: Final = re.compile(r"(?<=[^\W\d_])(\d+)\b")
_PATH: Final = re.compile(r"(?<![\w.])[^\W\d_]\w*(?:\.\w+)+")
_PRIVATE: Final = re.compile(r"(?<!\w)_\w*")


def _without_paths(text: str, names: Collection[str], reader: "_Reader") -> str:
    if not any("." in name for name in names):
        return text

    def placed(match: re.Match[str]) -> str:
        return reader.add_path(match.group()) if match.group() in names else match.group()

    return _PATH.sub(placed, text)


def _without_units(text: str, names: Container[str], reader: "_Reader") -> str:
    """Return a text in which placeholders stand for the numbers with units, which are read.

    A unit ends before the name of a quantity, and before a second word that is no unit.
    """
    parts, at = [], 0
    for match in _QUANTITY.finditer(text):
        if match.start() < at:
            continue
        number, words = match.groups()
        end = 0
        for segment in _SEGMENT.finditer(words):
            word = segment.group(1)
            if word in names or iskeyword(word) or (end and not _is_unit(word)):
                break
            end = segment.end()
        if end:
            unit = words[:end]
            place = reader.add(number, unit)
            parts += [text[at : match.start()], place]
            at = match.start(2) + end
    return "".join([*parts, text[at:]]).replace("^", "**")


def _spelled(unit: str) -> str:
    """Return a unit as pint reads it: `kg/m3` and `kg/m**3` are `kg/m^3`."""
    return _EXPONENT.sub(r"^\1", unit.replace("**", "^"))


def _is_unit(word: str) -> bool:
    try:
        dimension_of(_spelled(word))
    except ValueError:
        return False
    return True


class _Reader:
    """Converts the nodes of Python's syntax that are arithmetic, and refuses all others."""

    def __init__(self, text: str, recorded: bool) -> None:
        self.text = text
        self.recorded = recorded
        self.nodes = 0
        self.quantities: dict[str, Number] = {}
        self.negatives: dict[str, tuple[str, str]] = {}
        """Numbers with a minus sign, and units, where the unit has an offset."""
        self.paths: dict[str, str] = {}
        """Paths of numbers of the scene, by the placeholders that stand for them."""

    def add_path(self, path: str) -> str:
        """Return the placeholder that stands for a path."""
        place = f"{_PLACEHOLDER}path{len(self.paths)}{_PLACEHOLDER}"
        self.paths[place] = path
        return place

    def add(self, number: str, unit: str) -> str:
        """Read a number with a unit, and return the placeholder that stands for it."""
        place = f"{_PLACEHOLDER}{len(self.quantities)}{_PLACEHOLDER}"
        self.quantities[place] = quantity = self.quantity(number, unit)
        if quantity.offset:
            self.negatives[place] = f"-{number}", unit
        return f" {place} "

    def quantity(self, number: str, unit: str) -> Number:
        spelled, text = _spelled(unit), f"{number} {unit}"
        value, offset = in_base_units(number, spelled), has_offset(spelled)
        if not math.isfinite(value):
            raise ValueError(f"has the number '{text}', which is too large")
        if offset and value < 0.0 and not self.recorded:
            raise ValueError(f"has the temperature '{text}', which is below absolute zero")
        return Number(value, dimension_of(spelled), text, offset)

    def operand(self, node: ast.expr) -> Node:
        """Return the node of an operand; raise a ValueError if it is none to compute with."""
        found = self.node(node)
        if isinstance(found, Number) and found.offset and not self.recorded:
            raise ValueError(
                f"computes with '{found.text}', whose unit has an offset; write a temperature in "
                "K, and a difference in K or delta_degC"
            )
        return found

    def node(self, node: ast.expr) -> Node:
        """Return a node; raise a ValueError if it is not allowed."""
        self.nodes += 1
        if self.nodes > MAX_NODES:
            raise ValueError(f"is too long; at most {MAX_NODES} numbers, names and operators")
        match node:
            case ast.Constant(value=bool() | complex()):
                pass
            case ast.Constant(value=int() | float() as value):
                return self.number(value)
            case ast.Name(id=name) if name in self.quantities:
                return self.quantities[name]
            case ast.Name(id=name) if name in self.paths:
                return Name(self.paths[name])
            case ast.Name(id=name) if not name.startswith(_PLACEHOLDER):
                return Name(name)
            case ast.UnaryOp(op=ast.USub(), operand=ast.Name(id=name)) if name in self.negatives:
                return self.quantity(*self.negatives[name])
            case ast.UnaryOp(op=ast.USub(), operand=operand):
                return Operation("-", (self.operand(operand),))
            case ast.UnaryOp(op=ast.UAdd(), operand=operand):
                return self.node(operand)
            case ast.BinOp(left=left, op=op, right=right) if type(op) in _BINARY:
                return Operation(_BINARY[type(op)], (self.operand(left), self.operand(right)))
        what = ast.unparse(node)
        for place, text in {
            **self.paths,
            **{k: n.text for k, n in self.quantities.items()},
        }.items():
            what = what.replace(place, text)
        raise ValueError(f"is {quoted(self.text)}, which has {quoted(what)}; {ALLOWED}")

    def number(self, value: float) -> Number:
        if not abs(value) <= sys.float_info.max:
            raise ValueError(f"is {quoted(self.text)}, which has a number that is too large")
        return Number(float(value), PURE, f"{float(value):g}")
