"""The `scene` section: box, grains, laws and engine."""

import math
from collections.abc import Iterator, Mapping
from contextlib import nullcontext
from typing import TYPE_CHECKING, Annotated, Any, ClassVar, Final, Literal, NamedTuple, Self

from numpy.typing import ArrayLike

from agglom_mpi.declaration.choices import Choice, choice_of
from agglom_mpi.declaration.components import (
    In,
    UnknownComponentError,
    Whole,
    class_named,
    components_within,
    names_of,
)
from agglom_mpi.declaration.declared import LATER, Declared, FieldPath, Meaning, Problems, Reads
from agglom_mpi.declaration.given_values import SIZES, one_of
from agglom_mpi.declaration.laws import Law, Values
from agglom_mpi.declaration.reading import Reading
from agglom_mpi.declaration.units import quoted, to_si
from agglom_mpi.declaration.users_code import users_code
from agglom_mpi.physics.contact import CompressionRecoveryDuration, ContactArea, Duration
from agglom_mpi.physics.cooling import Cooling, NoCooling
from agglom_mpi.physics.fragmentation import Fragmentation, NoFragmentation
from agglom_mpi.physics.friction import Friction, NoFriction
from agglom_mpi.physics.hardness import ArrheniusHardness, ConstantHardness, Hardness
from agglom_mpi.physics.heating import Heating, PairSplit
from agglom_mpi.physics.impact_solvers import BracketedRoot
from agglom_mpi.physics.reaction import NoReaction, Reaction
from agglom_mpi.physics.restitution import ImpactLaws, PressureRestitution, Restitution, Solver
from agglom_mpi.physics.rough import SpinningFriction
from agglom_mpi.physics.size_distributions import SizeLaw, third_moment
from agglom_mpi.physics.sizes import Sizes, are_lengths
from agglom_mpi.physics.velocities import Velocities
from agglom_mpi.simulation.boundary import Boundary, Periodic
from agglom_mpi.simulation.engines import Engine, EventDriven
from agglom_mpi.variables import TEN

if TYPE_CHECKING:
    from agglom_mpi.simulation.scene import Scene


def parse_engine(text: str, own: Engine) -> Engine:
    """Return the engine that a short text names.

    Parameters
    ----------
    text
        `event`, `fixed`, `fixed:STEPS` or `adaptive`.
    own
        The scene's engine, which its name alone stands for.

    Raises
    ------
    ValueError
        If the text is none of these; with what is allowed.
    """
    law, colon, steps = text.strip().partition(":")
    engines = {name: kind() for name, kind in Engine.components().items()} | {own.name: own}
    names = [
        short
        for name, engine in engines.items()
        for short in (name, f"{name}:STEPS")
        if short == name or engine.with_steps(1) is not None
    ]
    engine = engines.get(law)
    is_count = steps.isdecimal() and steps.isascii() and len(steps) < 19 and int(steps) >= 1
    if engine is not None and not colon:
        return engine
    found = engine.with_steps(int(steps)) if engine is not None and is_count else None
    if found is None:
        allowed = f"{', '.join(names)}; STEPS must be a whole number from 1"
        raise ValueError(f"is {quoted(text)}; allowed: {allowed}")
    return found


def _read_end_time(value: Any) -> Any:
    if value == "characteristic":
        return value
    if isinstance(value, str) and value.isidentifier():
        raise ValueError(f"is {quoted(value)}; must be `characteristic` or a time like '10 ms'")
    time = to_si(value, "s")
    if time <= 0:
        raise ValueError(f"is {quoted(value)}; must be greater than 0 s")
    return time


EndTime = Annotated[
    float | Literal["characteristic"],
    Reads(_read_end_time),
    Meaning("`characteristic` or a time like '10 ms'"),
]


ENGINE_KEY: Final = "engine"
"""Field of the engine, which is a law of how a sample is computed, not of what happens in it."""


MAX_PARTICLES: Final = 10**7
"""Maximum number of grains of a sample."""


class SceneLaw(NamedTuple):
    """A law of a scene: its key, the law, and whether anything in the scene uses it."""

    key: str
    law: Law
    is_used: bool


class SceneSection(Declared):
    """Section `scene`: box, submodels and engine; lengths in m, times in s.

    Where it gives the size of the grains, `half_width` is None and follows for each string. `sizes`
    None: all grains are equal.

    Attributes
    ----------
    particles
        Number of grains at the start.
    half_width
        Half the edge of the cubic box; the size of the grains follows from the volume fraction.
    grain_diameter
        Mean diameter of the grains; replaces `half_width`, which then follows.
    grain_radius
        Mean radius of the grains; replaces `half_width`, which then follows.
    sizes
        Law of the diameters; without it all grains are equal.
    escape
        What happens to a grain that leaves the box.
    velocities
        Velocities at the start.
    restitution
        Fraction of the approach speed that a pair keeps, and condition for bonding.
    duration
        Duration of a contact; determines its mean force and pressure.
    contact_area
        Area of a contact; determines its pressure and the heat of reaction.
    hardness
        Hardness of the surface as a function of temperature.
    friction
        Tangential impulse of an impact.
    heating
        Distribution of the dissipated energy over the two grains.
    reaction
        Heat released by touching surfaces.
    fragmentation
        Condition for an impact to break an aggregate, and number of pieces.
    cooling
        How grains lose heat between impacts.
    solver
        Method that solves the equation e = G(e) of an impact.
    end_time
        End of a sample: a time, or `characteristic`, 44 times the time that a grain at the critical
        speed needs to cross a gap [A 13].
    engine
        Method that moves grains from impact to impact.
    """

    NUMBERS: ClassVar[Mapping[str, In]] = {
        **{key: In("m", above=0) for key in SIZES},
        "end_time": In("s", above=0),
    }
    """Its own fields that are real numbers; those of its laws are declared by these."""
    SUPPLIED: ClassVar[Mapping[str, str]] = {
        "half_width": "follows from the other two keys of a size, or from sizes in m",
        "hardness": "arrhenius; constant where restitution has no hardness",
    }
    """Texts on fields without a default that need not be given."""

    particles: Annotated[
        int,
        Whole(at_least=2, at_most=MAX_PARTICLES, meaning="the number of grains"),
    ]
    half_width: Annotated[float | None, In("m", above=0)] = None
    grain_diameter: Annotated[float | None, In("m", above=0), LATER] = None
    grain_radius: Annotated[float | None, In("m", above=0), LATER] = None
    sizes: Annotated[Sizes | None, Choice(Sizes), LATER] = None
    escape: Annotated[Boundary, Choice(Boundary)] = Periodic()
    velocities: Annotated[
        Velocities,
        Choice(Velocities),
        Meaning("allowed: " + ", ".join(Velocities.components())),
    ]
    restitution: Annotated[Restitution, Choice(Restitution)] = PressureRestitution()
    duration: Annotated[Duration, Choice(Duration)] = CompressionRecoveryDuration()
    contact_area: ContactArea = ContactArea()
    hardness: Annotated[Hardness, Choice(Hardness)]
    friction: Annotated[Friction, Choice(Friction, or_none=True, default="none")] = NoFriction()
    heating: Annotated[Heating, Choice(Heating, or_none=True, default="pair_split")] = PairSplit()
    reaction: Annotated[Reaction, Choice(Reaction, or_none=True, default="none")] = NoReaction()
    fragmentation: Annotated[Fragmentation, Choice(Fragmentation, or_none=True, default="none")] = (
        NoFragmentation()
    )
    cooling: Annotated[Cooling, Choice(Cooling, or_none=True)] = NoCooling()
    solver: Annotated[Solver, Choice(Solver)] = BracketedRoot()
    end_time: EndTime
    engine: Annotated[Engine, Choice(Engine)] = EventDriven()

    @property
    def size_key(self) -> str:
        """The key that says how large the scene is."""
        return next((key for key in SIZES if getattr(self, key) is not None), "sizes")

    @property
    def diameter(self) -> float | None:
        """Mean diameter of the grains in m; None where it follows from `half_width`."""
        if self.sizes is not None and self.sizes.mean_diameter is not None:
            return self.sizes.mean_diameter
        if self.grain_radius is not None:
            return 2.0 * self.grain_radius
        return self.grain_diameter

    @property
    def size_law(self) -> SizeLaw:
        """Law of radii over their mean; None: all grains are equal."""
        return None if self.sizes is None else self.sizes.size_law

    @property
    def third_moment(self) -> float:
        """Mean volume of the grains over that of their mean radius, 1 if all are equal."""
        return third_moment(self.size_law)

    @property
    def equivalent_grains(self) -> float:
        """Number of grains of the mean radius that have the volume of all."""
        return self.particles if self.sizes is None else self.particles * self.third_moment

    def in_volume(self, volume: int) -> Self:
        """Return the scene with `volume` times the grains in as many times the volume.

        The size of the grains, the volume fraction and a characteristic end time stay the same.
        """
        if volume == 1:
            return self
        changes: dict[str, object] = {"particles": volume * self.particles}
        if self.half_width is not None:  # it follows from the size of the grains otherwise
            changes["half_width"] = self.half_width * float(volume ** (1.0 / 3.0))
        return self.model_copy(update=changes)

    def entries(self) -> dict[str, Any]:
        """Return the fields as plain values: a diameter, or the half-width that it follows from."""
        entries = super().entries()
        if self.diameter is not None:
            del entries["half_width"]
            entries.pop("grain_radius", None)
            if self.size_key != "sizes":
                entries["grain_diameter"] = self.diameter
        return entries

    def build(self, parameters: Values | ArrayLike, engine: Engine | None = None) -> "Scene":
        """Return the scene of one parameter string as kernels see it.

        Its numbers are those of the section: `Campaign.at` returns the section of a string.

        The event engine has no time steps and cools exactly, whatever `integration` is; the
        steppers integrate as it says.

        Parameters
        ----------
        parameters
            The ten variables of the papers in SI units, by name, or in their order, shape (10,).
        engine
            Engine to use instead of the scene's.

        Raises
        ------
        ValueError
            If the scene cannot be simulated, with the reason.
        """
        from agglom_mpi.physics.scales import end_time, grain_mass, grain_radius, half_width
        from agglom_mpi.simulation.scene import Scene

        value = parameters if isinstance(parameters, Mapping) else TEN.values_by_name(parameters)
        laws = (getattr(self, key) for key in MAY_BE_OWN)
        within = (inner for law in laws if law is not None for _, inner in components_within(law))
        own = [law.name for law in within if law.own is not None]
        engine = engine or self.engine
        unused = self.heating.is_absent and math.isnan(value["temperature"])
        with users_code(", ".join(own)) if own else nullcontext():
            return Scene(
                escape=self.escape.build(value),
                velocities=self.velocities.build(value),
                laws=self.impact_laws(value),
                cooling=self.cooling.integrated(value, engine.has_time_steps),
                engine=engine.build(value),
                particles=self.particles,
                half_width=half_width(self, value),
                radius=grain_radius(self, value),
                mass=grain_mass(self, value),
                temperature=0.0 if unused else value["temperature"],
                end_time=end_time(self, value),
                sizes=self.size_law,
            )

    @property
    def has_spins(self) -> bool:
        """Whether grains spin."""
        return isinstance(self.friction, SpinningFriction)

    def impact_laws(self, value: Values) -> ImpactLaws:
        """Return the laws of an impact; None where restitution needs no contact pressure."""
        pressure = self.restitution.uses_contact_pressure
        return ImpactLaws(
            restitution=self.restitution.build(value),
            duration=self.duration.build(value) if pressure else None,
            contact_area=self.contact_area.build(value),
            hardness=self.hardness.build(value) if pressure else None,
            friction=self.friction.build(value),
            heating=self.heating.build(value),
            reaction=self.reaction.build(value),
            fragmentation=self.fragmentation.build(value),
            solver=self.solver.build(value) if pressure else None,
            heat_capacity=math.inf if self.heating.is_absent else value["heat_capacity"],
        )

    def laws(self) -> Iterator[SceneLaw]:
        """Yield the laws of impacts, of motion and of cooling, in the order of their fields.

        Laws within a law follow it, with their path as key: `restitution.dry`.
        """
        pressure = self.restitution.uses_contact_pressure
        unused: tuple[str, ...] = () if pressure else ("duration", "hardness", "solver")
        unused += ("contact_area",) if not pressure and self.reaction.is_absent else ()
        for key in type(self).model_fields:
            law = getattr(self, key)
            if isinstance(law, Law) and key != ENGINE_KEY:
                for path, each in law.with_inner_laws(key):
                    yield SceneLaw(path, each, not each.is_absent and key not in unused)

    @classmethod
    def prepared(
        cls, values: Mapping[Any, Any], reading: Reading
    ) -> tuple[Mapping[Any, Any], Problems]:
        """Return what a file gives with a law of hardness, and with one size of the scene."""
        other = "sizes that are lengths" if are_lengths(values.get("sizes"), reading) else ""
        kept, problems = one_of(SIZES, cls.with_default_hardness(values, reading), other)
        if not other and not any(key in values for key in SIZES):
            like = "half the edge, like '1 cm', or grain_diameter, like '50 um', or sizes in m"
            problems.append((("half_width",), f"is missing; {like}"))
        return kept, problems

    @classmethod
    def with_default_hardness(cls, data: Mapping[Any, Any], reading: Reading) -> Mapping[Any, Any]:
        """Return a scene as it is in a file, with the law of hardness that it leaves to others."""
        if "hardness" in data:
            return data
        needed = _needs_pressure(data.get("restitution"), reading)
        (name,) = names_of(ArrheniusHardness if needed else ConstantHardness)
        return {**data, "hardness": name}

    def problems(self) -> Iterator[tuple[FieldPath, str]]:
        """Yield laws that do not fit each other."""
        softens = self.hardness.softened_by is not None
        if softens and not self.restitution.uses_contact_pressure:
            yield (
                ("hardness",),
                f"is {self.hardness.name!r}, but {self.restitution.name} restitution has no "
                "hardness; leave it out",
            )
        if self.end_time == "characteristic" and not self.restitution.has_critical_speed:
            have = (n for n, law in Restitution.components().items() if law.has_critical_speed)
            yield (
                ("end_time",),
                f"is 'characteristic', which needs the critical speed of one of "
                f"{', '.join(have)}; give a time like '10 ms'",
            )
        if self.cooling.by_steps and not self.engine.has_time_steps:
            yield (
                ("cooling", "integration"),
                f"is 'euler', which needs time steps, but the engine is {self.engine.name!r}; "
                "allowed: exact, or euler with engine fixed or adaptive",
            )
        if message := self.refused(self.engine):
            yield (ENGINE_KEY,), message
        others = [f"friction {self.friction.name!r}, by which grains spin"] * self.has_spins
        others += [f"escape {self.escape.name!r}"] * bool(self.escape.is_sheared())
        own = (("heating", self.heating), ("fragmentation", self.fragmentation))
        for key, of_one in own if others else ():
            if of_one.is_frame_dependent():
                yield (
                    (key,),
                    f"is {of_one.name!r}, which counts the motion of each grain alone, but the "
                    f"scene has {others[0]}; must be a law by the energy of the pair, or none",
                )
        for key, law in (("reaction", self.reaction), ("cooling", self.cooling)):
            if self.heating.is_absent and not law.is_absent:
                message = f"is {law.name!r}, but heating is 'none'; allowed without heating: none"
                yield (key,), message

    def refused(self, engine: Engine) -> str:
        """Return why an engine cannot run the scene; empty if it can."""
        if not (self.escape.is_sheared() and engine.has_time_steps):
            return ""
        return (
            f"is {engine.name!r}, but escape is {self.escape.name!r}, whose images move between "
            "the steps; must be 'event'"
        )


def _needs_pressure(entry: Any, reading: Reading) -> bool:
    """Return whether a file's entry for a restitution, or one within it, solves e = G(e)."""
    name = entry.get("law") if isinstance(entry, dict) else entry
    if not isinstance(name, str):
        return PressureRestitution.needs_contact_pressure
    try:
        law = class_named(Restitution, name, reading)
    except UnknownComponentError:  # its own field says so
        return False
    inner = [entry[key] for key in law.inner_fields() if isinstance(entry, dict) and key in entry]
    return law.needs_contact_pressure or any(_needs_pressure(each, reading) for each in inner)


MAY_BE_OWN: Final = tuple(
    key
    for key, field in SceneSection.model_fields.items()
    for choice in [choice_of(field)]
    if choice is not None and choice.kind.may_be_own
)
"""Fields of the laws that a scene may have from a module of one's own."""
