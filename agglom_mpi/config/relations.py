"""Derived quantities and constraints of a campaign: sections `derived` and `constraints`."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from agglom_mpi.config.expressions import (
    Comparison,
    Node,
    evaluate,
    names_in,
    satisfied,
    text_of,
)
from agglom_mpi.config.quantities import quantity_values

if TYPE_CHECKING:
    from agglom_mpi.config.string_scenes import StringScenes

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
        for each in in_order({each.name: each.tree for each in self.derived}):
            texts[each] = text_of(self._trees[each], texts)
        return [_canonical(constraint, texts) for constraint in self.constraints]

    @property
    def _trees(self) -> dict[str, Node]:
        return {each.name: each.tree for each in self.derived}

    def _tested(
        self, scenes: "StringScenes", parameters: Parameters
    ) -> Iterator[tuple[str, NDArray[np.bool_]]]:
        names = [n for each in self.constraints for node in each.operands for n in names_in(node)]
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


def _canonical(constraint: Comparison, texts: Mapping[str, str]) -> str:
    operands = [text_of(node, texts) for node in constraint.operands]
    pairs = zip(constraint.operators, operands[1:], strict=True)
    return " ".join([operands[0], *(f"{symbol} {operand}" for symbol, operand in pairs)])


class CircularError(ValueError):
    """Derived quantities that are defined by one another."""


def in_order(trees: Mapping[str, Node]) -> list[str]:
    """Return names in an order in which each comes after those that its tree names.

    Raises
    ------
    CircularError
        If there is none.
    """
    order: dict[str, None] = {}
    under: list[str] = []

    def add(name: str) -> None:
        if name in under:
            circle = [*under[under.index(name) :], name]
            raise CircularError(f"is defined by itself: {' -> '.join(circle)}")
        if name in trees and name not in order:
            under.append(name)
            for inner in dict.fromkeys(names_in(trees[name])):
                add(inner)
            under.pop()
            order[name] = None

    for name in trees:
        add(name)
    return list(order)
