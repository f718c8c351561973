"""Laws: components whose formulas are compiled into the kernels of a scene."""

import collections
from collections.abc import Callable, Iterator, Mapping
from typing import Any, ClassVar, NamedTuple, Self, TypeAlias

from agglom_mpi.compilation.stages import Submodel, declare_numbers, formula, law_of
from agglom_mpi.declaration.choices import choice_of
from agglom_mpi.declaration.components import Component, components_within, number_of
from agglom_mpi.declaration.declared import FieldPath
from agglom_mpi.variables import TEN

_named_tuple: Any = collections.namedtuple  # of names known when it is run, which mypy refuses
Values: TypeAlias = Mapping[str, float]
"""The ten variables in SI units, by name."""


class Group(NamedTuple):
    """A dimensionless group, but for constants.

    Attributes
    ----------
    symbol
        As it is printed: `ρv²/H`.
    meaning
    powers
        Power of each variable by name, and of the `grain_radius`.
    """

    symbol: str
    meaning: str
    powers: Mapping[str, float]


class Reported(NamedTuple):
    """A number of a law that `agglom check` displays, such as the Stokes number of a mean pair.

    Attributes
    ----------
    label
        At most 24 characters.
    unit
        SI unit.
    evaluate
        Returns the number for the law, the section `scene` and the variables by name in SI units.
    note
        Explanation, one line.
    """

    label: str
    unit: str
    evaluate: Callable[[Any, Any, Values], float]
    note: str = ""


class Law(Component):
    """Base class of the laws of a scene.

    Formulas are methods. Compiled kernels call them with a NamedTuple in place of `self` that holds
    the law's numbers and variables, so that they use nothing else of it.

    Attributes
    ----------
    variables
        Variables of the string that the formulas use, as further attributes of `self`.
    derived
        Properties of the law, calculated once for each scene, that the formulas use.
    needs
        Variables that the law needs beside those, such as the temperature that it starts from.
    groups
        Dimensionless groups that the law depends on.
    constants
        SI units of the physical constants in the formulas, such as `J/mol/K` of the gas constant;
        `agglom check` tests the law in units that leave these constants as they are.
    is_absent
        Whether it stands for leaving out what its kind does; kernels then see None.
    Numbers
        The NamedTuple that kernels see: fields that are numbers, or laws as their `Numbers`, then
        `derived` and `variables`.
    """

    found_in = "agglom_mpi.physics"
    variables: ClassVar[tuple[str, ...]] = ()
    derived: ClassVar[tuple[str, ...]] = ()
    needs: ClassVar[tuple[str, ...]] = ()
    groups: ClassVar[tuple[Group, ...]] = ()
    constants: ClassVar[tuple[str, ...]] = ()
    is_absent: ClassVar[bool] = False
    Numbers: ClassVar[Any]

    def __init_subclass__(cls, **options: Any) -> None:
        """Make the NamedTuple that kernels see."""
        super().__init_subclass__(**options)
        inner = cls.inner_fields()
        own = [n for n, field in cls.model_fields.items() if number_of(field) or n in inner]
        names = (*own, *cls.derived, *cls.variables)
        given = [cls.model_fields[name] for name in own] if len(own) == len(names) else []
        defaults = [field.default for field in given if not field.is_required()]
        numbers: Any = _named_tuple(cls.__name__, names, defaults=defaults)
        numbers.__module__ = cls.__module__
        numbers.__qualname__ = f"{cls.__qualname__}.Numbers"  # so that it can be pickled
        if cls.own is not None:
            numbers.__reduce__ = _reduced_numbers
            # Numba names the machine code of a function by the names of its arguments' types.
            numbers.__name__ = f"{cls.__module__}_{cls.__qualname__}"
        cls.Numbers = numbers
        declare_numbers(numbers, cls)

    @classmethod
    def check_own(cls) -> None:
        """Raise a TypeError or ValueError if what a class of one's own declares is wrong."""
        super().check_own()
        for key, names in (("variables", cls.variables), ("needs", cls.needs)):
            if not isinstance(names, tuple) or not set(names) <= set(TEN.names):
                must = f"a tuple of some of {', '.join(TEN.names)}"
                raise TypeError(f"{key} of {cls.__name__} is {names!r}; must be {must}")
        for name in (*cls.variables, *cls.derived):
            if name in cls.model_fields:
                raise TypeError(f"field {name} of {cls.__name__} is also one of its variables")

    @classmethod
    def lacking(cls) -> Iterator[tuple[str, str]]:
        """Yield each formula that is missing; an absent law needs none."""
        return iter(()) if cls.is_absent else super().lacking()

    def build(self, value: Values) -> Submodel:
        """Return the law's numbers as kernels see them, None if it is absent.

        Parameters
        ----------
        value
            The ten variables in SI units, by name.
        """
        if self.is_absent:
            return None
        inner = {name: getattr(self, name).build(value) for name in self.inner_fields()}
        given = inner | {name: value[name] for name in self.variables}
        fields = self.Numbers._fields
        return self.Numbers(
            *(given[name] if name in given else getattr(self, name) for name in fields)
        )

    @classmethod
    def inner_fields(cls) -> tuple[str, ...]:
        """Return the names of the fields that are laws themselves."""
        return tuple(name for name, field in cls.model_fields.items() if choice_of(field))

    def with_inner_laws(self, path: str) -> "Iterator[tuple[str, Law]]":
        """Yield this law with its path in a scene, and all laws within it with theirs."""
        return ((".".join(at), law) for at, law in components_within(self, path))

    def reported(self) -> Iterator[Reported]:
        """Yield numbers that follow from the law, for `agglom check`."""
        yield from ()

    def cautions(self, scene: Any, value: Values) -> Iterator[tuple[FieldPath, str]]:
        """Yield what is doubtful about the law in a scene: the field below its own, and why.

        Parameters
        ----------
        scene
            The `scene` section of a campaign.
        value
            The variables in SI units, by name.
        """
        yield from ()

    def is_frame_dependent(self) -> bool:
        """Return whether its results depend on the frame of reference.

        Where none of a scene does, the simulation works in the centre-of-mass frame.
        """
        return False

    @classmethod
    def absent(cls) -> type[Self]:
        """Return the law of this kind that stands for leaving it out.

        Raises
        ------
        TypeError
            If there is none.
        """
        for law in cls.components().values():
            if law.is_absent:
                return law
        raise TypeError(f"a scene cannot leave out its {cls.__name__}")

    @property
    def required(self) -> tuple[str, ...]:
        """Variables without which the law cannot be evaluated."""
        return (*self.variables, *self.needs)


def _reduced_numbers(numbers: Any) -> Any:
    """Return how the numbers of a law of one's own are pickled: with its class."""
    return _numbers_of, (law_of(numbers), tuple(numbers))


def _numbers_of(law: type[Law], values: tuple[Any, ...]) -> Any:
    return law.Numbers(*values)


is_frame_dependent = formula(Law, Law.is_frame_dependent)
