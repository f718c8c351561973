"""A class that a file can name defines what its kind needs, or is refused where it is declared."""

from typing import ClassVar, Literal

import pytest

from agglom_mpi.config.campaign import Campaign  # noqa: F401  (imports all kinds)
from agglom_mpi.declaration.components import Component
from agglom_mpi.physics.cooling import Cooling
from agglom_mpi.physics.friction import ConstantFriction, Friction
from agglom_mpi.search.methods.method import PopulationMethod
from agglom_mpi.search.objectives.objective import Objective
from agglom_mpi.search.stopping import AdaptiveRule


def kinds(kind):
    """Yield all classes of components of the package, but for what stands in for one's own."""
    for below in kind.__subclasses__():
        if below.__module__.startswith("agglom_mpi.") and below.own is None:
            yield below
            yield from kinds(below)


def lacking(kind, **attributes):
    """Return what a class that a file can name by `foo` lacks, by its declaration."""
    attributes = {"in_files": False, "__module__": __name__, **attributes}
    declared = type("Foo", (kind,), attributes)
    return {name for name, _ in declared.lacking()}


def test_no_class_of_the_package_lacks_anything():
    named = [kind for kind in kinds(Component) if kind.names()]
    assert len(named) > 40
    assert not [kind for kind in named if list(kind.lacking())]


def test_a_law_without_a_formula_is_refused_with_class_and_formula():
    with pytest.raises(TypeError, match=r"Half .*impulse_slopes of Friction"):

        class Half(Friction):
            law: Literal["half"] = "half"
            summary: ClassVar[str] = "half"

            def tangential_impulse(self, pair, deficit):
                return 0.0


def test_every_formula_and_the_summary_are_asked_for():
    assert lacking(Friction) == {"tangential_impulse", "impulse_slopes", "summary"}
    assert lacking(ConstantFriction) == set()
    assert lacking(Cooling) == {"cooling_rate", "exact_temperature", "rest_temperature", "summary"}
    assert lacking(Objective) == {"accumulator", "of_samples", "influence_values", "summary"}
    assert lacking(PopulationMethod) == {"build", "summary"}
    assert lacking(AdaptiveRule) == {"holds", "label", "summary"}


def test_a_law_that_stands_for_leaving_its_kind_out_needs_no_formula():
    assert lacking(Friction, is_absent=True) == set()


def test_a_field_stands_for_a_method_of_its_name():
    class Counted(PopulationMethod):
        in_files = False
        first_generation: int

    assert "first_generation" not in {name for name, _ in Counted.lacking()}
