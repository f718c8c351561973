"""A class that a file can name defines what its kind needs, or is refused where it is declared."""

from typing import ClassVar, Literal

import pytest

from agglom_mpi.config.campaign import Campaign  # noqa: F401  (imports all kinds)
from agglom_mpi.declaration.components import Component
from agglom_mpi.declaration.own_modules import OwnModule, class_in
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


HEAD = """\
from typing import Annotated, ClassVar
from agglom_mpi.components import In, Restitution, RestitutionSolution, Whole

class Law(Restitution):
    summary: ClassVar[str] = "a law"
    {line}
"""


def made(line):
    source = HEAD.format(line=line).encode()
    return class_in(OwnModule.of("law.py", source), "Law")


@pytest.mark.parametrize(
    "name",
    [
        "source_sha256",
        "name",
        "entries",
        "own",
        "variables",
        "problems",
        "build",
    ],
)
def test_a_field_hides_nothing_that_the_package_uses(name):
    with pytest.raises(ValueError, match=rf"law\.py:4 raises TypeError: field {name} "):
        made(f'{name}: Annotated[float, In("1")] = 0.5')


@pytest.mark.parametrize(
    ("line", "value"),
    [
        ('value: Annotated[float, In("1", at_most=1)] = 7.0', "7.0"),
        ('value: Annotated[float, In("1")] = "abc"', "'abc'"),
        ('value: Annotated[float, In("1")] = True', "true"),
        ('value: Annotated[float, In("1")] = float("nan")', "nan"),
        ('value: Annotated[float, In("1")] = None', "empty"),
        ("value: Annotated[int, Whole()] = 1.5", "1.5"),
        ("value: Annotated[int, Whole(at_least=1)] = 0", "0"),
        ('value: Annotated[tuple[float, float], In("1")] = (1.0,)', "1.0"),
        ('value: Annotated[tuple[float, float], In("1", above=0)] = (1.0, -2.0)', "-2.0"),
        ('value: Annotated[list[float], In("1")] = [1.0]', "list"),
        ('value: Annotated[tuple[float, ...], In("1")] = (1.0,)', "tuple"),
        ('value: Annotated[bool, In("1")] = True', "bool"),
        ("value: Annotated[float, Whole()] = 1", "float"),
        ('value: Annotated[float, In("km")] = 1.0', "km"),
    ],
)
def test_a_number_has_a_type_and_a_default_that_a_file_could_give(line, value):
    with pytest.raises(ValueError, match=r"law\.py:4 raises (Type|Value)Error: ") as error:
        made(line)
    assert value in str(error.value)


@pytest.mark.parametrize(
    "line",
    [
        'value: Annotated[float, In("m")]',
        'value: Annotated[float, In("m")] = 1',
        'value: Annotated[float | None, In("m", above=0)] = None',
        'value: Annotated[tuple[float, float], In("m", above=0)] = (1.0, 2.0)',
        'density: Annotated[float, In("kg/m^3")] = 1.0',
        "value: Annotated[int, Whole(at_least=1)] = 3",
        'variables = ("friction",)',
    ],
)
def test_what_a_file_could_give_is_accepted(line):
    assert made(line).names() == ("law.py:Law",)


@pytest.mark.parametrize(
    "line",
    [
        'variables = ("friction", "nothing")',
        'variables = "friction"',
        'needs = ("restitution.value",)',
        'variables = ("friction",); friction: Annotated[float, In("1")] = 1.0',
    ],
)
def test_variables_of_a_law_are_some_of_the_ten_and_no_fields(line):
    with pytest.raises(ValueError, match=r"law\.py:4 raises TypeError: .*(friction|needs)"):
        made(line)
