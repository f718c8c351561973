"""A class of one's own whose fields cannot be read, recorded or compiled is refused at its line."""

import pytest

from agglom_mpi.declaration.own_modules import OwnModule, class_in

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
