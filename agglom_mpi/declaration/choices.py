"""The choice of a component: a field of a campaign file, by name or with its numbers."""

from collections.abc import Callable, Mapping
from functools import cache
from typing import TYPE_CHECKING, Annotated, Any, NamedTuple, Union, get_args

from agglom_mpi.declaration.components import Component, UnknownComponentError, class_named
from agglom_mpi.declaration.declared import FieldError, Reads
from agglom_mpi.declaration.own_modules import own_error
from agglom_mpi.declaration.reading import PLAIN, Reading, names_own, reading_of
from agglom_mpi.declaration.units import quoted
from agglom_mpi.declaration.users_code import users_code
from agglom_mpi.errors import named_error

if TYPE_CHECKING:
    from pydantic import GetCoreSchemaHandler, ValidationInfo
    from pydantic_core import CoreSchema


class Choice(NamedTuple):
    """Marks a field whose value is one of the components of a kind, by name or with its numbers.

    Attributes
    ----------
    kind
        Base class of the components.
    or_none
        Whether an empty entry stands for the component `none`.
    default
        Name of the component that a mapping without a name is; empty if it must have one.
    is_inner
        Whether the field belongs to a component of the same kind, as the dry law of a wet one. Its
        schema is then made when a value is first read, as it contains itself.
    """

    kind: type[Component]
    or_none: bool = False
    default: str = ""
    is_inner: bool = False

    @property
    def components(self) -> tuple[type[Component], ...]:
        """The components to choose from."""
        return tuple(dict.fromkeys(self.kind.components().values()))

    def __get_pydantic_core_schema__(
        self, source: Any, handler: "GetCoreSchemaHandler"
    ) -> "CoreSchema":
        """Return the schema of a union whose members are distinguished by name."""
        from pydantic import Field
        from pydantic_core import core_schema

        if self.is_inner:
            return core_schema.with_info_plain_validator_function(
                lambda entry, info: _adapter(self).validate_python(entry, context=info.context)
            )
        union: Any = Union.__getitem__(self.components)  # of a number known when it is run
        tagged = Annotated[union, Field(discriminator=self.kind.named_by)]
        schema = handler.generate_schema(Annotated[tagged, Reads(self._as_mapping)])
        if self.kind.may_be_own:
            schema = core_schema.with_info_wrap_validator_function(self._read, schema)
        return core_schema.nullable_schema(schema) if type(None) in get_args(source) else schema

    def own_class(self, entry: Any, reading: Reading) -> type[Component] | None:
        """Return the class of one's own that an entry of a file names, None if it names none.

        Raises
        ------
        FieldError
            If the class cannot be had.
        """
        is_mapping = isinstance(entry, Mapping)
        name = entry.get(self.kind.named_by) if is_mapping else entry
        if not (self.kind.may_be_own and names_own(name)):
            return None
        try:
            return class_named(self.kind, name, reading)
        except UnknownComponentError as error:
            path = (self.kind.named_by,) if is_mapping else ()
            raise FieldError((path, str(error))) from error

    def class_of(self, entry: Any, reading: Reading = PLAIN) -> type[Component]:
        """Return the class that an entry of a file names.

        Raises
        ------
        UnknownComponentError, ValueError
            If it names none that is known.
        """
        mapping = self._as_mapping(entry)
        if isinstance(mapping, Component):
            return type(mapping)
        return class_named(self.kind, mapping.get(self.kind.named_by), reading)

    def _read(self, entry: Any, validate: Callable[[Any], Any], info: "ValidationInfo") -> Any:
        """Return the component of an entry: of one's own, or one of the package."""
        if isinstance(entry, self.kind):
            return entry
        reading = reading_of(info)
        own = self.own_class(entry, reading)
        if own is None:
            return validate(entry)
        return _made_own(own, self._as_mapping(entry), reading)

    def _as_mapping(self, entry: Any) -> Any:
        if self.default and isinstance(entry, dict) and self.kind.named_by not in entry:
            return {self.kind.named_by: self.default, **entry}
        return self.kind.as_mapping("none" if self.or_none and entry is None else entry)


@cache
def _adapter(choice: Choice) -> Any:
    """Return what reads a value of an inner choice."""
    from pydantic import TypeAdapter

    tagged: Any = Annotated[choice.kind, choice._replace(is_inner=False)]
    return TypeAdapter(tagged)


def choice_of(field: Any) -> Choice | None:
    """Return the choice that a field of a section or a component is; None if it is none."""
    return next((each for each in field.metadata if isinstance(each, Choice)), None)


def _made_own(own: type[Component], entry: Any, reading: Reading) -> Component:
    """Return a component of one's own of an entry of a file."""
    name = next(iter(own.names()), own.__name__)
    try:
        with users_code(name):
            made = own.checked(entry, reading)
            summary = made.summary
    except Exception as error:
        if isinstance(error, ValueError) and not own_error(error):
            raise
        raise ValueError(
            f"is {quoted(name)}, but {own_error(error) or named_error(error)}"
        ) from error
    if not isinstance(summary, str):
        raise ValueError(f"is {quoted(name)}, whose summary is {summary!r}; must be a text")
    return made
