"""Formulas of a law of one's own, compiled alone: what Numba cannot compile, in one line."""

import inspect
from collections.abc import Callable, Iterator
from typing import Any, get_type_hints

import numpy as np

from agglom_mpi.compilation.single_formulas import UncompiledFormulaError, compile_alone
from agglom_mpi.compilation.stages import Submodel, formulas_of, law_of, laws_in
from agglom_mpi.errors import UserError
from agglom_mpi.physics.pair import ContactPair
from agglom_mpi.physics.restitution import ImpactLaws
from agglom_mpi.simulation.scene import Scene

PACKAGE = __name__.partition(".")[0]


class UncompiledLawError(UserError, TypeError):
    """A law of one's own has a formula that Numba cannot compile."""


def own_formulas(law: type) -> dict[str, Callable[..., Any]]:
    """Return the formulas of a law that no module of the package defines, by name."""
    methods = {name: getattr(law, name) for name in formulas_of(law)}
    return {
        name: method
        for name, method in methods.items()
        if method.__module__.partition(".")[0] != PACKAGE
    }


def compiled_formulas(numbers: Submodel, laws: ImpactLaws) -> dict[str, Callable[..., Any]]:
    """Compile the formulas of a law of one's own, each alone, and return them by name.

    Parameters
    ----------
    numbers
        The law's numbers, as kernels see them.
    laws
        Laws of an impact, which formulas may be given.

    Raises
    ------
    UncompiledLawError
        If one cannot be compiled, takes other arguments, or returns something else.
    """
    law, compiled = law_of(numbers), {}
    bases = formulas_of(law)
    for name, method in own_formulas(law).items():
        try:
            arguments = (numbers, *_example_arguments(bases[name], laws))
            compiled[name] = compile_alone(method, bases[name], arguments)
        except UncompiledFormulaError as error:
            raise UncompiledLawError(str(error)) from error
    return compiled


def check_own_laws(scene: Scene) -> None:
    """Compile the formulas of all laws of one's own in a scene, each alone.

    Raises
    ------
    UncompiledLawError
        If one cannot be compiled.
    """
    cooling = () if scene.cooling is None else (scene.cooling.law,)
    for numbers in laws_in((*scene[:2], *scene.laws, *cooling, scene.engine)):
        compiled_formulas(numbers, scene.laws)


def _example_arguments(base: Callable[..., Any], laws: ImpactLaws) -> Iterator[Any]:
    """Yield arguments of the types that kernels call a formula with, without the first one."""
    examples = {
        "laws": laws,
        "friction": laws.friction,
        "pair": ContactPair(*[1.0] * len(ContactPair._fields)),
        "random": np.random.default_rng(0),
        "velocity": np.zeros((3, 1)),
    }
    hints = get_type_hints(base)
    for name in list(inspect.signature(base).parameters)[1:]:
        yield examples[name] if name in examples else hints[name](1)
