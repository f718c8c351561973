"""Derived quantities and constraints of a campaign: sections `derived` and `constraints`."""

import re
from collections import Counter
from collections.abc import Container, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from agglom_mpi.config.expression_reader import read_comparison, read_expression
from agglom_mpi.config.expressions import (
    PURE,
    Comparison,
    Dimension,
    Name,
    Node,
    common_dimension,
    dimension,
    dimension_of,
    evaluate,
    names_in,
    nodes_of,
    satisfied,
    text_of,
    unit_of,
)
from agglom_mpi.config.quantities import BY_NAME, CONSTANTS, quantity_values, units_of
from agglom_mpi.declaration.declared import FieldError, FieldPath, raise_field_errors
from agglom_mpi.declaration.reading import PLAIN, Reading
from agglom_mpi.declaration.units import quoted
from agglom_mpi.outcome import OUTCOME, quantity_columns
from agglom_mpi.variables import TEN, VOLUME_FRACTION, VariableTable

if TYPE_CHECKING:
    from agglom_mpi.config.string_scenes import StringScenes

MAX_ENTRIES: Final = 30
"""Largest numbers of derived quantities and of constraints."""
MAX_SIZE: Final = 1000
"""Largest number of nodes of a derived quantity in which all others are written out."""
_NAME: Final = re.compile(r"[a-z][a-z0-9_]{0,29}")
NAME_RULE: Final = "must be small letters, digits and _, a letter first, at most 30 characters"

_COLUMNS: Final = """
best_objective best_standard_error best_string cpu_seconds crc digest estimate evaluations
    failed finished fresh generation growth_number hit_maximum lower mean_grains mean_of_top
    name objective origin parent_1 parent_2 parents population processor_seconds rank
    reestimate sample samples samples_simulated samples_used searched searched_objective
    searched_standard_error seconds slot standard_error string top unit upper used
"""
COLUMNS: Final = frozenset({*_COLUMNS.split(), *(OUTCOME.names or ())}) - BY_NAME.keys()
"""Columns of tables, whose names no derived quantity may have."""

Problems = list[tuple[FieldPath, str]]
Parameters = Mapping[str, NDArray[np.float64]]


class Derived(NamedTuple):
    """A derived quantity: its name, text, tree and SI unit."""

    name: str
    text: str
    tree: Node
    unit: str


@dataclass(frozen=True, eq=False)
class Relations:
    """The derived quantities and constraints of a campaign.

    Attributes
    ----------
    derived
        Quantities in the order of the file.
    constraints
        Comparisons; a proposed string satisfies all of them.
    """

    derived: tuple[Derived, ...] = ()
    constraints: tuple[Comparison, ...] = ()

    def values(self, scenes: "StringScenes", parameters: Parameters) -> dict[str, Any]:
        """Return the derived quantities of n strings in SI units, each (n,), by name.

        Parameters
        ----------
        scenes
            Of the campaign, whose quantities they may name.
        parameters
            The variables in SI units, each (n,).
        """
        names = [each.name for each in self.derived]
        values = self._evaluated(scenes, names, parameters)
        shape = np.shape(next(iter(parameters.values())))
        return {name: np.broadcast_to(values[name], shape) for name in names}

    def allowed(self, scenes: "StringScenes", parameters: Parameters) -> NDArray[np.bool_]:
        """Return which of n strings satisfy all constraints, (n,); arguments as for `values`."""
        allowed = np.ones(np.shape(next(iter(parameters.values()))), np.bool_)
        for _, holds in self._tested(scenes, parameters):
            allowed &= holds
        return allowed

    def broken(self, scenes: "StringScenes", parameters: Parameters) -> list[str]:
        """Return the texts of the constraints that some of the strings do not satisfy."""
        return [text for text, holds in self._tested(scenes, parameters) if not np.all(holds)]

    def canonical(self) -> list[str]:
        """Return the constraints in SI units, with derived quantities written out.

        Spelling and the names of derived quantities do not matter to it.
        """
        texts: dict[str, str] = {}
        trees = self._trees
        for name in in_order(trees):
            texts[name] = text_of(trees[name], texts)
        return [
            " ".join(
                f"{symbol} {text_of(node, texts)}".strip()
                for symbol, node in zip(("", *each.operators), each.operands, strict=True)
            )
            for each in self.constraints
        ]

    @property
    def _trees(self) -> dict[str, Node]:
        return {each.name: each.tree for each in self.derived}

    def _tested(
        self, scenes: "StringScenes", parameters: Parameters
    ) -> Iterator[tuple[str, NDArray[np.bool_]]]:
        names = [name for each in self.constraints for name in names_in(*each.operands)]
        values = self._evaluated(scenes, names, parameters)
        for constraint in self.constraints:
            yield constraint.text, satisfied(constraint, values)

    def _evaluated(
        self, scenes: "StringScenes", names: Sequence[str], parameters: Parameters
    ) -> dict[str, Any]:
        """Return the values of all that these names need, derived quantities after their own."""
        trees = self._trees
        wanted, needed = list(names), set[str]()
        while wanted:
            name = wanted.pop()
            if name not in needed:
                needed.add(name)
                wanted += names_in(trees[name]) if name in trees else ()
        needed -= parameters.keys()  # a variable may have the name of a quantity, as grain_diameter
        values = dict(parameters) | quantity_values(scenes, needed, parameters)
        for name in in_order({name: tree for name, tree in trees.items() if name in needed}):
            values[name] = evaluate(trees[name], values)
        return values


NO_RELATIONS: Final = Relations()


def in_order(trees: Mapping[str, Node]) -> list[str]:
    """Return names in an order in which each comes after those that its tree names.

    Raises
    ------
    FieldError
        If there is none, at a name that is defined by itself.
    """
    order: dict[str, None] = {}
    under: list[str] = []

    def add(name: str) -> None:
        if name in under:
            circle = [*under[under.index(name) :], name]
            raise FieldError(((name,), f"is defined by itself: {' -> '.join(circle)}"))
        if name in trees and name not in order:
            under.append(name)
            for inner in dict.fromkeys(names_in(trees[name])):
                add(inner)
            under.pop()
            order[name] = None

    for name in trees:
        add(name)
    return list(order)


def read_derived(value: Any, used: Sequence[str], reading: Reading = PLAIN) -> tuple[Derived, ...]:
    """Return the quantities of the section `derived`; raise a FieldError.

    Parameters
    ----------
    value
        The section as it is in the file.
    used
        Names of the variables that the scene depends on.
    reading
        The variables of the campaign, and whether a run has recorded the text.
    """
    if not isinstance(value, dict):
        message = f"is {quoted(value)}; must be a mapping like {{pressure: density * speed^2}}"
        raise FieldError(((), message))
    _require_few(value)
    problems: Problems = [((name,), message) for name in value if (message := _name_problem(name))]
    known = units_of(used, reading.variables)
    names = {*reading.variables.names, *known, *value}
    trees: dict[str, Node] = {}
    for name, entry in value.items():
        try:
            trees[name] = read_expression(_text(entry), names, reading.recorded)
        except ValueError as error:
            problems.append(((name,), str(error)))
    raise_field_errors(problems)  # an unknown name may be one of these
    return _checked(value, trees, known, reading.variables)


def _checked(
    value: Mapping[str, Any],
    trees: Mapping[str, Node],
    known: Mapping[str, str],
    table: VariableTable,
) -> tuple[Derived, ...]:
    """Return the quantities of trees; raise a FieldError unless dimensions and sizes are right."""
    order = in_order(trees)
    problems: Problems = []
    dimensions = {name: dimension_of(unit) for name, unit in known.items()}
    sizes: dict[str, int] = {}
    for name in order:
        nodes = nodes_of(trees[name])
        sizes[name] = sum(sizes.get(n.name, 1) if isinstance(n, Name) else 1 for n in nodes)
        try:
            if sizes[name] > MAX_SIZE:
                raise ValueError(f"is too long; at most {MAX_SIZE} terms with all written out")
            check_names((trees[name],), {*dimensions, *trees}, table)
            dimensions[name] = dimension(trees[name], dimensions) or PURE
        except ValueError as error:
            problems.append(((name,), str(error)))
            dimensions[name] = PURE
    raise_field_errors(problems)
    return tuple(Derived(n, _text(value[n]), trees[n], unit_of(dimensions[n])) for n in trees)


def _require_few(value: Mapping[str, Any] | Sequence[Any]) -> None:
    if len(value) > MAX_ENTRIES:
        raise FieldError(((), f"has {len(value)} entries; must be at most {MAX_ENTRIES}"))


def _name_problem(name: str) -> str:
    if not _NAME.fullmatch(name):
        return f"is no name for a quantity; {NAME_RULE}"
    taken = {
        "variable": name in TEN or name == VOLUME_FRACTION.name,
        "quantity that every scene has": name in CONSTANTS or name in BY_NAME,
        "column of the tables": name in COLUMNS,
    }
    of = next((kind for kind, is_taken in taken.items() if is_taken), "")
    return f"is the name of a {of}; choose another" if of else ""


def quantity_problems(
    names: Sequence[str], derived: Sequence[Derived], others: Iterable[str] = ()
) -> Problems:
    """Return problems of quantities of samples whose columns would have the names of others.

    Each has a column of its mean, and of the standard error; so have its estimates.

    Parameters
    ----------
    names
        Names of the quantities.
    derived
        Derived quantities, which have columns, too.
    others
        Further quantities of the same samples.
    """
    taken, problems = Counter(each.name for each in derived), Problems()
    taken.update(column for name in (*names, *others) for column in quantity_columns(name))
    for name in names:
        message = _name_problem(name)
        twice = [column for column in quantity_columns(name) if taken[column] > 1]
        if not message and twice:
            message = f"has a column {twice[0]}, which is another one's, too; choose another"
        if message:
            problems.append(((name,), message))
    return problems


def _text(entry: Any, example: str = "0.5 * density") -> str:
    """Return the text of an expression, which may be a plain number."""
    if isinstance(entry, int | float) and not isinstance(entry, bool):
        return repr(entry)
    if not isinstance(entry, str):
        raise ValueError(f"is {quoted(entry)}; must be a text like '{example}'")
    return entry


def check_names(nodes: Iterable[Node], known: Container[str], table: VariableTable) -> None:
    """Raise a ValueError if a tree names a variable on which the scene does not depend."""
    for name in names_in(*nodes):
        if name in table and name not in known:
            raise ValueError(f"names '{name}', on which this scene does not depend")


def read_constraints(
    value: Any, used: Sequence[str], derived: Sequence[Derived], reading: Reading = PLAIN
) -> tuple[Comparison, ...]:
    """Return the comparisons of the section `constraints`; raise a FieldError.

    Parameters
    ----------
    value
        The section as it is in the file.
    used
        Names of the variables that the scene depends on.
    derived
        Quantities that they may name, too.
    reading
        As for `read_derived`.
    """
    if not isinstance(value, list) or not value:
        message = "must be a list of texts like ['pressure < 0.1 * hardness']"
        raise FieldError(((), f"is {quoted(value)}; {message}"))
    _require_few(value)
    units = units_of(used, reading.variables) | {each.name: each.unit for each in derived}
    dimensions: dict[str, Dimension] = {name: dimension_of(unit) for name, unit in units.items()}
    problems: Problems = []
    found = []
    for i, entry in enumerate(value):
        try:
            found.append(_constraint(entry, dimensions, reading))
        except ValueError as error:
            problems.append(((i,), str(error)))
    raise_field_errors(problems)
    return tuple(found)


def _constraint(entry: Any, dimensions: Mapping[str, Dimension], reading: Reading) -> Comparison:
    comparison = read_comparison(
        _text(entry, "pressure < 0.1 * hardness"),
        {*reading.variables.names, *dimensions},
        reading.recorded,
    )
    check_names(comparison.operands, dimensions, reading.variables)
    common_dimension(comparison.operands, dimensions, "in a comparison")
    if CONSTANTS.keys() >= {*names_in(*comparison.operands)}:
        raise ValueError(f"is {quoted(entry)}, which depends on nothing")
    return comparison
