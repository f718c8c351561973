"""The choice of a component: a field of a campaign file, by name or with its numbers."""

from collections.abc import Callable, Mapping
from types import NoneType
from typing import Any, NamedTuple, get_args

from agglom_mpi.declaration.components import Component, UnknownComponentError, class_named
from agglom_mpi.declaration.declared import FieldError
from agglom_mpi.declaration.own_modules import own_error
from agglom_mpi.declaration.reading import PLAIN, Reading, names_own
from agglom_mpi.declaration.units import quoted
from agglom_mpi.declaration.users_code import users_code
from agglom_mpi.errors import named_error


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
        Whether the field belongs to a component of the same kind, as the dry law of a wet one.
    """

    kind: type[Component]
    or_none: bool = False
    default: str = ""
    is_inner: bool = False

    def read_field(
        self, value: Any, kind: Any, reading: Reading, inner: Callable[[Any], Any]
    ) -> Component | None:
        """Return the component of the class that an entry names; None where the type allows it."""
        is_none = value is None and NoneType in get_args(kind)
        return None if is_none else self.read(value, reading)

    def read(self, entry: Any, reading: Reading) -> Component:
        """Return the component of an entry of a file.

        Raises
        ------
        FieldError
            If its class cannot be had.
        ValueError
            If its values do not fit.
        """
        if isinstance(entry, self.kind):
            return entry
        mapping, key = self._as_mapping(entry), self.kind.named_by
        if key not in mapping:
            raise FieldError(((key,), f"is missing; allowed: {', '.join(self.kind.components())}"))
        try:
            found = class_named(self.kind, mapping[key], reading)
        except UnknownComponentError as error:
            is_own = self.kind.may_be_own and names_own(mapping[key])
            known = ", ".join(self.kind.components())
            if self.kind.may_be_own and ":" in str(mapping[key]):
                known += "; a class of your own is FILE.py:Class"
            message = str(error) if is_own else f"is {quoted(mapping[key])}; allowed: {known}"
            path = (key,) if isinstance(entry, Mapping) and key in entry else ()
            raise FieldError((path, message)) from error
        return _made_own(found, mapping, reading) if found.own else found.checked(mapping, reading)

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

    def _as_mapping(self, entry: Any) -> Any:
        if self.default and isinstance(entry, dict) and self.kind.named_by not in entry:
            return {self.kind.named_by: self.default, **entry}
        found = self.kind.as_mapping("none" if self.or_none and entry is None else entry)
        if names_own(found):  # says that its code may not run, or what is wrong with it
            return {self.kind.named_by: found}
        if not isinstance(found, Mapping | Component):
            raise ValueError(f"is {quoted(entry)}; must be a mapping")
        return found


def choice_of(field: Any) -> Choice | None:
    """Return the choice that a field of a section or a component is; None if it is none."""
    return next((each for each in field.metadata if isinstance(each, Choice)), None)


def _made_own(own: type[Component], entry: Any, reading: Reading) -> Component:
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
