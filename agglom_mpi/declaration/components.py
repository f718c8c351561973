"""Components: what a campaign file names, each declared in one class.

A component is a law, an objective, a search method or a stopping rule. Its class states its name,
its numbers with unit, limits and meaning, a summary, and what it computes. The keys of a campaign
file, their errors, the lines of `agglom check` and the identity of a campaign are derived from the
class. Adding a component takes one class; nothing else lists it.
"""

from collections.abc import Iterator
from functools import partial
from typing import Annotated, Any, ClassVar, Literal, NamedTuple, Self, Union, get_args, get_origin

from pydantic import BeforeValidator, Field, GetCoreSchemaHandler, model_validator
from pydantic.fields import FieldInfo
from pydantic_core import CoreSchema

from agglom_mpi.declaration.sections import (
    NAMED,
    NAMED_OR_NONE,
    FieldPath,
    Section,
    raise_field_errors,
)
from agglom_mpi.declaration.units import to_si


class In(NamedTuple):
    """Unit, limits and meaning of a number: `emissivity: Annotated[float, In("1", at_most=1)]`.

    Attributes
    ----------
    unit
        SI unit, a key of `units.KINDS`; a file may give any unit of the same dimension.
    above, at_least, at_most, below
        Limits in that unit.
    meaning
        What the number is, as it is said where it is missing.
    """

    unit: str = "1"
    above: float | None = None
    at_least: float | None = None
    at_most: float | None = None
    below: float | None = None
    meaning: str = ""

    def __get_pydantic_core_schema__(
        self, source: Any, handler: GetCoreSchemaHandler
    ) -> CoreSchema:
        """Return the schema that reads a number with a unit and checks its limits."""
        limits = Field(gt=self.above, ge=self.at_least, le=self.at_most, lt=self.below)
        read = BeforeValidator(partial(to_si, unit=self.unit))
        return handler.generate_schema(Annotated[float, read, limits])


class Component(Section):
    """Base class of everything that a campaign file names.

    A subclass that a file can name has a field with the name as its only value, such as
    `law: Literal["constant"] = "constant"`.

    Attributes
    ----------
    named_by
        Key of the field with the name.
    """

    named_by: ClassVar[str] = "law"

    @property
    def name(self) -> str:
        """Name in a campaign file."""
        return names_of(type(self))[0]

    @property
    def summary(self) -> str:
        """One line on the component, as `agglom check` prints it."""
        raise NotImplementedError

    def problems(self) -> Iterator[tuple[FieldPath, str]]:
        """Yield fields that do not fit together: the path of each and what is wrong."""
        yield from ()

    @model_validator(mode="after")
    def _fits_together(self) -> Self:
        raise_field_errors(list(self.problems()))
        return self

    @classmethod
    def components(cls) -> dict[str, type[Self]]:
        """Return the components of this kind by name, in the order of their declaration."""
        found: dict[str, type[Self]] = {}
        for below in cls.__subclasses__():
            found |= dict.fromkeys(names_of(below), below)
            found |= below.components()
        return found

    def settings(self) -> Iterator[tuple[str, Any, str, bool]]:
        """Yield name, value, unit and whether it was given of each field but the name."""
        for name, field in type(self).model_fields.items():
            if name != self.named_by:
                unit = unit_of(field)
                yield name, getattr(self, name), unit, name in self.model_fields_set


def names_of(component: type[Section]) -> tuple[str, ...]:
    """Return the name by which a file can call a component; empty for a base class."""
    if not issubclass(component, Component):
        return ()
    field = component.model_fields.get(component.named_by)
    literal = field is not None and get_origin(field.annotation) is Literal
    return get_args(field.annotation) if field is not None and literal else ()


def number_of(field: FieldInfo) -> In | None:
    """Return unit, limits and meaning of a field that is a number; None of other fields."""
    return next((each for each in field.metadata if isinstance(each, In)), None)


def unit_of(field: FieldInfo) -> str:
    """Return the SI unit of a field; `1` where it is a pure number or none."""
    number = number_of(field)
    return "1" if number is None else number.unit


class Choice(NamedTuple):
    """Marks a field whose value is one of the components of a kind, by name or with its numbers.

    Attributes
    ----------
    kind
        Base class of the components.
    or_none
        Whether an empty entry stands for the component `none`.
    """

    kind: type[Component]
    or_none: bool = False

    @property
    def components(self) -> tuple[type[Component], ...]:
        """The components to choose from."""
        return tuple(dict.fromkeys(self.kind.components().values()))

    def __get_pydantic_core_schema__(
        self, source: Any, handler: GetCoreSchemaHandler
    ) -> CoreSchema:
        """Return the schema of a union that is told apart by the name."""
        named = NAMED_OR_NONE if self.or_none else NAMED
        union: Any = Union.__getitem__(self.components)  # of a number known when it is run
        tagged = Annotated[union, Field(discriminator=self.kind.named_by)]
        return handler.generate_schema(Annotated[tagged, named])
