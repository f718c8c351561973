"""Components: what a campaign file names, each declared in one class.

A component is a law, an objective, a search method or a stopping rule. Its class states its name,
its numbers with unit, limits and meaning, a summary, and what it computes. The keys of a campaign
file, their errors, the lines of `agglom check` and the identity of a campaign are derived from the
class. Adding a component takes one class; nothing else lists it.
"""

import pkgutil
from collections.abc import Callable, Iterator, Mapping
from functools import cache
from importlib import import_module
from typing import (
    Annotated,
    Any,
    ClassVar,
    Literal,
    NamedTuple,
    Self,
    TypeVar,
    get_args,
    get_origin,
)

from agglom_mpi.declaration.declared import Declared, DeclaredField, WholeNumber, named, read_value
from agglom_mpi.declaration.needed import check_names, check_number, missing_methods, needed
from agglom_mpi.declaration.own_modules import OwnModule, own_module
from agglom_mpi.declaration.reading import PLAIN, Reading, names_own
from agglom_mpi.declaration.units import quoted, to_si
from agglom_mpi.errors import UserError
from agglom_mpi.formatting import in_unit
from agglom_mpi.variables import Limits


class UnknownComponentError(UserError, ValueError):
    """A name that no component of a kind has, as in a file of a later version."""


C = TypeVar("C", bound="Component")


class In(NamedTuple):
    """Unit, limits and meaning of a number: `emissivity: Annotated[float, In("1", at_most=1)]`.

    The field may be a tuple of such numbers, or a number that is None by default.

    Attributes
    ----------
    unit
        SI unit, such as a key of `units.KINDS`; a file may give any unit of the same dimension.
    above, at_least, at_most, below
        Limits in that unit.
    meaning
        Meaning of the number, for the message where it is missing.
    """

    unit: str = "1"
    above: float | None = None
    at_least: float | None = None
    at_most: float | None = None
    below: float | None = None
    meaning: str = ""

    @property
    def limits(self) -> Limits:
        """The limits alone, in the unit."""
        return Limits(self.above, self.at_least, self.at_most, self.below)

    def read_field(
        self, value: Any, kind: Any, reading: Reading, inner: Callable[[Any], Any]
    ) -> Any:
        """Return a number with a unit within the limits, or a tuple of them."""
        if get_origin(kind) is tuple:
            several = tuple.__class_getitem__((Annotated[float, self],) * len(get_args(kind)))
            return read_value(value, several, (), reading)
        return _within(self, to_si(value, self.unit), value)


class Setting(NamedTuple):
    """A number or choice of a component: name, value, SI unit, and whether a file gave it."""

    name: str
    value: Any
    unit: str
    is_given: bool


class Whole(NamedTuple):
    """Limits and meaning of a whole number: `order: Annotated[int, Whole(at_least=1, at_most=4)]`.

    Attributes
    ----------
    at_least, at_most
        Limits.
    multiple_of
        Divisor of the number.
    meaning
        Meaning of the number, for the message where it is missing.
    """

    at_least: int | None = None
    at_most: int | None = None
    multiple_of: int | None = None
    meaning: str = ""

    @property
    def unit(self) -> str:
        """Unit of a pure number."""
        return "1"

    @property
    def limits(self) -> Limits:
        """The limits alone."""
        return Limits(at_least=self.at_least, at_most=self.at_most)

    def read_field(
        self, value: Any, kind: Any, reading: Reading, inner: Callable[[Any], Any]
    ) -> Any:
        """Return a whole number within the limits."""
        number = _within(self, read_value(value, WholeNumber, (), reading), value)
        if self.multiple_of is not None and number % self.multiple_of:
            raise ValueError(f"is {quoted(value)}; must be a multiple of {self.multiple_of}")
        return number


def _within(of: In | Whole, number: Any, value: Any) -> Any:
    """Return a number; raise a ValueError that quotes the value if it breaks a limit."""
    if broken := of.limits.broken_by(number):
        raise ValueError(f"is {quoted(value)}; must be {in_unit(broken, of.unit)}")
    return number


class Component(Declared):
    """Base class of everything that a campaign file names.

    A subclass that a file can name has a field with the name as its only value, such as
    `law: Literal["constant"] = "constant"`.

    Attributes
    ----------
    named_by
        Key of the field with the name.
    found_in
        Package whose modules declare the components of this kind.
    in_files
        Whether a file can name it, and not only another component can become it.
    may_be_own
        Whether a file can name a class of one's own of this kind, `FILE.py:Class`.
    not_in_files
        Fields that a file does not give: they are read from elsewhere.
    example
        Smallest entry of a campaign file with the numbers that it needs; empty: its name is one.
    breaks
        Properties of its kind that the class means to break, by name, and why; `agglom check`
        prints them.
    own
        Module of a class of one's own, which is named `FILE.py:Class`; None for the package's.
    """

    named_by: ClassVar[str] = "law"
    found_in: ClassVar[str] = ""
    in_files: ClassVar[bool] = True
    may_be_own: ClassVar[bool] = True
    not_in_files: ClassVar[tuple[str, ...]] = ()
    example: ClassVar[str] = ""
    breaks: ClassVar[Mapping[str, str]] = {}
    own: ClassVar[OwnModule | None] = None

    def __init_subclass__(cls, **options: Any) -> None:
        """Give a class of one's own its name, and refuse one of the package that is not complete.

        Raises
        ------
        TypeError
            If the class lacks what its kind needs. One of one's own may be a base class, and is
            checked when a file names it.
        """
        super().__init_subclass__(**options)
        cls.own = own_module(cls.__module__)
        if cls.own is not None and cls.may_be_own:
            name = f"{cls.own.file}:{cls.__name__}"  # whatever name it has declared
            others = {key: field for key, field in cls.model_fields.items() if key != cls.named_by}
            literal: Any = Literal.__getitem__(name)
            cls.model_fields = {cls.named_by: DeclaredField(literal, (), name), **others}
            setattr(cls, cls.named_by, name)
            cls.check_own()
        elif cls.names():
            cls.check_complete()

    @classmethod
    def check_own(cls) -> None:
        """Raise a TypeError or ValueError if fields of a class of one's own are wrong."""
        check_names(cls, cls.base())
        for name, field in cls.model_fields.items():
            number = number_of(field)
            if number is not None:
                kind = float if isinstance(number, In) else int
                check_number(name, field, number, kind)

    @classmethod
    def base(cls) -> type["Component"]:
        """Return the class of the package that this one is, or is derived from."""
        return next(kind for kind in cls.__mro__ if issubclass(kind, Component) and not kind.own)

    @classmethod
    def check_complete(cls) -> None:
        """Raise a TypeError if the class lacks a method that its kind needs."""
        if lacking := list(cls.lacking()):
            wanted = " and ".join(f"{name} of {kind}" for name, kind in lacking)
            raise TypeError(f"class {cls.__qualname__} does not define {wanted}")

    @classmethod
    def lacking(cls) -> Iterator[tuple[str, str]]:
        """Yield each method that the class lacks, and the base class that needs it."""
        return missing_methods(cls)

    @property
    def name(self) -> str:
        """Name in a campaign file; empty of a component without alternatives."""
        return next(iter(self.names()), "")

    @property
    @needed
    def summary(self) -> str:
        """One line on the component, as `agglom check` prints it."""
        raise NotImplementedError

    def entries(self) -> dict[str, Any]:
        """Return the fields as plain values, the name first; see `Declared.entries`.

        A component of one's own has the digest of its module, too, and what that has read.
        """
        entries = super().entries()
        name = {key: entries[key] for key in (self.named_by,) if key in entries}
        own = own_module(type(self).__module__)
        return name | entries | ({} if own is None else own.entries())

    @classmethod
    def components(cls) -> dict[str, type[Self]]:
        """Return the components of this kind by name, by module and in the order of declaration."""
        if cls.found_in:
            import_modules(cls.found_in)
        return {
            name: each
            for each in sorted(_subclasses(cls), key=lambda each: each.__module__)
            for name in each.names()
        }

    @classmethod
    def names(cls) -> tuple[str, ...]:
        """Return the names that a file can have for this class; none for a base class."""
        return names_of(cls)

    @classmethod
    def as_mapping(cls, entry: Any) -> Any:
        """Return the entry of a file for this kind as a mapping: `foo` is `{law: foo}`.

        Raises
        ------
        ValueError
            If it can be none.
        """
        return named(entry)

    @classmethod
    def of_entries(cls, entries: Mapping[str, Any], reading: Reading = PLAIN) -> Self:
        """Return the component of a recorded campaign.

        Parameters
        ----------
        entries
            Its section as plain values, as `entries` returned it; what an identity has beside the
            fields, such as the digest of a function's source, is left out.
        reading
            Finds components of one's own.

        Raises
        ------
        UnknownComponentError
            If there is no such component.
        ValueError
            If it lacks entries.
        """
        return class_named(cls, entries.get(cls.named_by), reading).recorded(entries)

    def settings(self) -> Iterator[Setting]:
        """Yield all fields but the name, and those that are components themselves."""
        for name, field in type(self).model_fields.items():
            value = getattr(self, name)
            if name != self.named_by and not isinstance(value, Component):
                yield Setting(name, value, unit_of(field), name in self.model_fields_set)


def components_within(component: C, *path: str) -> Iterator[tuple[tuple[str, ...], C]]:
    """Yield a component at a path, and all of its kind that are fields of it or of these."""
    yield path, component
    for name in component.model_fields:
        inner = getattr(component, name)
        if isinstance(inner, Component):
            yield from components_within(inner, *path, name)  # type: ignore[misc]


@cache
def import_modules(package: str) -> None:
    """Import the modules of a package, so that the components that they declare are known."""
    for module in pkgutil.iter_modules(import_module(package).__path__):
        import_module(f"{package}.{module.name}")


def _subclasses(kind: type[Any]) -> Iterator[type[Any]]:
    """Yield the package's subclasses, as they are declared; those of subclasses after these."""
    for below in kind.__subclasses__():
        if below.own is None:
            yield below
            yield from _subclasses(below)


def class_named(kind: type[C], name: Any, reading: Reading = PLAIN) -> type[C]:
    """Return the component of a kind by its name in a file, one of one's own included.

    Raises
    ------
    UnknownComponentError
        If there is none; with the reason, or the names that are known.
    """
    if kind.may_be_own and names_own(name):
        return _own_class(kind, name, reading)
    found = kind.components()
    if not isinstance(name, str) or name not in found:
        known = ", ".join(found)
        raise UnknownComponentError(f"{kind.named_by} {name!r} is unknown; known: {known}")
    return found[name]


def _own_class(kind: type[C], name: str, reading: Reading) -> type[C]:
    try:
        found = reading.own.find(name, kind)
    except ValueError as error:
        raise UnknownComponentError(str(error)) from error
    if not issubclass(found, kind):
        message = f"is {quoted(name)}, which is no subclass of {kind.__name__}"
        raise UnknownComponentError(message)
    if found.own is not None:
        try:
            found.check_complete()
        except TypeError as error:
            raise UnknownComponentError(f"is {quoted(name)}, but {error}") from None
    return found


def names_of(component: type[Declared]) -> tuple[str, ...]:
    """Return the name that a file can have for a component; empty for a base class."""
    if not issubclass(component, Component) or not component.in_files:
        return ()
    field = component.model_fields.get(component.named_by)
    literal = field is not None and get_origin(field.annotation) is Literal
    return get_args(field.annotation) if field is not None and literal else ()


def number_of(field: DeclaredField) -> In | Whole | None:
    """Return unit, limits and meaning of a field that is a number; None of other fields."""
    return next((each for each in field.metadata if isinstance(each, In | Whole)), None)


def unit_of(field: DeclaredField) -> str:
    """Return the SI unit of a field; `1` where it is a pure number or none."""
    number = number_of(field)
    return "1" if number is None else number.unit
