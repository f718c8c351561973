"""Planes through the space of dimensionless numbers in which the model is stiff or extreme.

A plane turns a scene into one with two given numbers, all others as they were, and says where any
scene lies in it. The event engine with the root finder and exact cooling must be sound everywhere
in a plane but where `excuse` says so.
"""

import math
from abc import abstractmethod
from collections.abc import Iterator, Mapping
from typing import Any, ClassVar, Final

import numpy as np
from numpy.typing import NDArray

from agglom_mpi.accuracy.maps.cells import Axis, MapPlane
from agglom_mpi.accuracy.maps.law_references import grain_of
from agglom_mpi.accuracy.maps.scene import MapScene, Values
from agglom_mpi.accuracy.study import with_scene
from agglom_mpi.accuracy.time_integration.published_method import as_published
from agglom_mpi.config.campaign import Campaign
from agglom_mpi.config.scene import SceneSection
from agglom_mpi.declaration.given_values import JAMMING_FRACTION
from agglom_mpi.physics import scales
from agglom_mpi.physics.constants import GAS_CONSTANT, STEFAN_BOLTZMANN
from agglom_mpi.physics.cooling import RadiativeCooling, rate_slope
from agglom_mpi.physics.hardness import ArrheniusHardness, ConstantHardness
from agglom_mpi.physics.impact_solvers import BracketedRoot, FixedPointIteration
from agglom_mpi.physics.reaction import ContactAreaReaction
from agglom_mpi.physics.restitution import ConstantRestitution
from agglom_mpi.physics.size_distributions import third_moment
from agglom_mpi.physics.sizes import UniformSizes
from agglom_mpi.simulation.engines import AdaptiveSteps, FixedSteps
from agglom_mpi.variables import size_ratio, volume_fraction

DEFAULT: Final = "event engine"
"""Name of the default method: exact times, root finder, exact cooling."""

FINE_STEPS: Final = 2000
"""Number of the finer equal steps; the coarser ones are the 200 of [A]."""

COLLISIONS: Final = 100.0
"""Collisions of a grain in the plane of inelastic collapse, by Haff's law."""

CONTACT_TIME: Final = 1e-2
"""Contact time in that plane, over the collision time at the start."""

LASTING: Final = "event engine, contact time"
"""Name of the default method with a contact time, which ends inelastic collapse."""

CEILING: Final = 1000.0
"""Longest over shortest adaptive step, as published [B 6.14]."""


class Plane(MapPlane):
    """Two dimensionless numbers, or a length and a speed, that a map varies.

    Attributes
    ----------
    remedy
        Name of the method that must be sound where the default one is excused; empty if none is.
    """

    remedy: ClassVar[str] = ""

    def refusal(self, scene: MapScene) -> str:
        """Return why a scene has no such plane; empty if it has one."""
        return ""

    @abstractmethod
    def campaign(self, scene: MapScene, x: float, y: float) -> Campaign:
        """Return the scene with these numbers; raise a CampaignError if it is refused."""

    @abstractmethod
    def point(self, section: SceneSection, values: Values) -> tuple[float, float]:
        """Return where a scene with given variables lies; nan where it has no such number."""

    def methods(self, campaign: Campaign, y: float, quick: bool) -> Iterator[tuple[str, Campaign]]:
        """Yield the names of the methods and the scene by each, the default one first."""
        yield from standard_methods(campaign, quick)

    def refusal_excuse(self, x: float, y: float) -> str:
        """Return the documented reason why a scene may be refused here; empty if there is none."""
        return ""


def standard_methods(campaign: Campaign, quick: bool) -> Iterator[tuple[str, Campaign]]:
    """Yield the default method, and one deviation from it at a time, where the scene has any."""
    scene = campaign.scene
    yield DEFAULT, campaign
    if scene.restitution.needs_contact_pressure:
        yield "published iteration", with_scene(campaign, solver=FixedPointIteration())
    yield from _steppers(campaign, FixedSteps(), "fixed, 200 steps")
    if not quick:
        fine = FixedSteps(steps=FINE_STEPS)
        yield f"fixed, {FINE_STEPS} steps", with_scene(campaign, engine=fine)
    engine = as_published(scene).engine
    if engine.shortest_step is None:  # equal steps, which are shown above
        floor = 1e-4 * float(scene.end_time)
        engine = AdaptiveSteps(floor=floor, ceiling=CEILING * floor)
    yield "adaptive", with_scene(campaign, engine=engine)


def _steppers(campaign: Campaign, engine: Any, name: str) -> Iterator[tuple[str, Campaign]]:
    """Yield a stepper with exact cooling and, where there is any, with that by Euler steps."""
    yield name, with_scene(campaign, engine=engine)
    stepped = campaign.scene.cooling.stepped()
    if stepped != campaign.scene.cooling:
        yield f"{name}, Euler cooling", with_scene(campaign, engine=engine, cooling=stepped)


class Softening(Plane):
    """Activation energy over RT against impact pressure over hardness: several roots, overflow."""

    name = "softening"
    title = "Thermal softening against impact pressure"
    x = Axis("activation energy over Rθ", -5.0, 6.0)
    y = Axis("impact pressure over 2H₀", -6.0, 5.0)

    def refusal(self, scene: MapScene) -> str:
        """Refuse restitution without contact pressure, and grains without temperature."""
        if not scene.section.restitution.needs_contact_pressure or scene.section.heating.is_absent:
            return "needs restitution by contact pressure, and heating"
        return ""

    def campaign(self, scene: MapScene, x: float, y: float) -> Campaign:
        """Set activation energy and hardness."""
        pressure = _pressure(scene.section, scene.values)
        energy = x * GAS_CONSTANT * scene.values["temperature"]
        values = {"activation_energy": energy, "hardness": pressure / (2.0 * y)}
        return scene.campaign(values, hardness=ArrheniusHardness())

    def point(self, section: SceneSection, values: Values) -> tuple[float, float]:
        """Return both numbers at the starting temperature and the relative speed."""
        if not section.restitution.needs_contact_pressure:
            return math.nan, math.nan
        exponent = values["activation_energy"] / (GAS_CONSTANT * values["temperature"])
        return exponent, _pressure(section, values) / (2.0 * values["hardness"])


class Heat(Plane):
    """Cooling time over collision time against reaction heat over heat content."""

    name = "heat"
    title = "Cooling against reaction heat"
    x = Axis("cooling time over collision time", -5.0, 8.0)
    y = Axis("reaction heat over heat content", -6.0, 5.0)

    def refusal(self, scene: MapScene) -> str:
        """Refuse grains without temperature."""
        return "needs heating" if scene.section.heating.is_absent else ""

    def campaign(self, scene: MapScene, x: float, y: float) -> Campaign:
        """Cool to the starting temperature by radiation, and by convection where that is slow."""
        area, temperature = 4.0 * math.pi * scene.radius**2, scene.values["temperature"]
        rate = scales.collision_rate(scene.section, scene.values)
        needed = scene.content * rate / (area * x)  # W/m²/K
        radiated = 4.0 * STEFAN_BOLTZMANN * temperature**3
        emissivity = min(1.0, needed / radiated)
        cooling = RadiativeCooling(
            emissivity=emissivity,
            surroundings=temperature,
            convection=max(0.0, needed - emissivity * radiated),
            ambient=temperature,
        )
        heat = y * scene.content * temperature / (math.pi * scene.radius**2)
        return scene.campaign(
            {"reaction_heat": heat}, reaction=ContactAreaReaction(), cooling=cooling
        )

    def point(self, section: SceneSection, values: Values) -> tuple[float, float]:
        """Return both numbers at the starting temperature."""
        if section.heating.is_absent:
            return math.nan, math.nan
        built = section.build(values)
        content = built.mass * values["heat_capacity"] * values["temperature"]
        heat = 0.0 if section.reaction.is_absent else values["reaction_heat"]
        share = heat * math.pi * built.radius**2 / content
        if built.cooling is None:
            return math.inf, share
        law, surface, capacity, _ = grain_of(built)
        slope = rate_slope(law, values["temperature"], surface, capacity)
        rate = scales.collision_rate(section, values)
        return (rate / slope if slope > 0.0 else math.inf), share


class Collapse(Plane):
    """Volume fraction against restitution: inelastic collapse, and random placement."""

    name = "collapse"
    title = "Volume fraction against restitution"
    x = Axis("volume fraction", -2.0, math.log10(0.7))
    y = Axis("restitution e", -2.0, 0.0)
    remedy = LASTING

    def campaign(self, scene: MapScene, x: float, y: float) -> Campaign:
        """Set the restitution, the size ratio, and the end time by the collision rate.

        By Haff's law [J. Fluid Mech. 134, 1983, 401] an impact takes the share q = (1 − e²)/6 of
        the speed, and a grain has had n collisions at ωt = (exp(qn) − 1)/q.
        """
        changed = scene.campaign(
            {"size_ratio": size_ratio(x, scene.section.third_moment)},
            restitution=ConstantRestitution(value=y),
            hardness=ConstantHardness(),
            solver=BracketedRoot(),
        )
        rate, share = _rate(changed), (1.0 - y * y) / 6.0
        if rate == 0.0:
            return changed
        return with_scene(changed, end_time=math.expm1(share * COLLISIONS) / (share * rate))

    def methods(self, campaign: Campaign, y: float, quick: bool) -> Iterator[tuple[str, Campaign]]:
        """Yield the standard methods, the second one the event engine with a contact time."""
        default, *others = standard_methods(campaign, quick)
        yield default
        law, rate = campaign.scene.restitution, _rate(campaign)
        time = CONTACT_TIME / rate if rate > 0.0 else float(campaign.scene.end_time)
        yield (
            LASTING,
            with_scene(campaign, restitution=law.model_copy(update={"contact_time": time})),
        )
        yield from others

    def refusal_excuse(self, x: float, y: float) -> str:
        """Excuse placement beyond random packing."""
        packed = f"random placement beyond a volume fraction of {JAMMING_FRACTION}"
        return packed if x > JAMMING_FRACTION else ""

    def point(self, section: SceneSection, values: Values) -> tuple[float, float]:
        """Return both numbers of a scene of constant restitution."""
        fraction = volume_fraction(values["size_ratio"], section.third_moment)
        return fraction, float(section.restitution.entries().get("value", math.nan))


class Masses(Plane):
    """Largest over smallest mass against steps per collision."""

    name = "masses"
    title = "Mass ratio against steps per collision"
    x = Axis("largest over smallest mass", 0.0, 3.0)
    y = Axis("steps per collision time", -2.0, 2.0)

    def campaign(self, scene: MapScene, x: float, y: float) -> Campaign:
        """Set uniform sizes, and the size ratio so that the volume fraction stays."""
        ratio = x ** (1.0 / 3.0)
        sizes = UniformSizes(ratio=ratio)
        size = size_ratio(scene.fraction, third_moment(sizes.size_law))
        return scene.campaign({"size_ratio": size}, sizes=sizes)

    def methods(self, campaign: Campaign, y: float, quick: bool) -> Iterator[tuple[str, Campaign]]:
        """Yield the event engine, which has no steps, and the steppers with these."""
        yield DEFAULT, campaign
        end_time, rate = float(campaign.scene.end_time), _rate(campaign)
        steps = max(1, round(y * rate * end_time)) if rate > 0.0 else 1
        yield from _steppers(campaign, FixedSteps(steps=steps), "fixed")
        floor = min(1.0 / (y * rate), end_time) if rate > 0.0 else end_time
        engine = AdaptiveSteps(floor=floor, ceiling=CEILING * floor)
        yield from _steppers(campaign, engine, "adaptive")

    def point(self, section: SceneSection, values: Values) -> tuple[float, float]:
        """Return the ratio of equal grains or that of a uniform law, and the published steps."""
        ratio = 1.0 if section.sizes is None else section.sizes.entries().get("ratio") or math.nan
        rate, engine = scales.collision_rate(section, values), as_published(section).engine
        if rate == 0.0:
            return math.nan, math.nan
        if engine.shortest_step is not None:
            return ratio**3, 1.0 / (rate * engine.shortest_step)
        return ratio**3, FixedSteps().steps / (rate * scales.end_time(section, values))


class Scale(Plane):
    """Speed against size, eleven decades of each, as many collisions everywhere."""

    name = "scale"
    title = "Speed against size"
    x = Axis("grain radius (m)", -9.0, 2.0)
    y = Axis("relative speed (m/s)", -6.0, 5.0)

    def campaign(self, scene: MapScene, x: float, y: float) -> Campaign:
        """Set box, speed, and the end time in proportion."""
        larger, faster = x / scene.radius, y / scene.values["relative_speed"]
        width = scene.centre.scene.half_width
        assert width is not None
        end_time = scene.end_time * larger / faster
        return scene.campaign({"relative_speed": y}, half_width=width * larger, end_time=end_time)

    def refusal(self, scene: MapScene) -> str:
        """Refuse grains at rest."""
        return "" if scene.values["relative_speed"] > 0.0 else "needs a relative speed above 0"

    def point(self, section: SceneSection, values: Values) -> tuple[float, float]:
        """Return the mean radius and the relative speed."""
        return scales.grain_radius(section, values), values["relative_speed"]


def _pressure(section: SceneSection, values: Values) -> float:
    """Return the pressure in Pa of an impact with the relative speed and e = 0."""
    return section.duration.pressure(values["density"], values["relative_speed"])


def _rate(campaign: Campaign) -> float:
    """Return the collisions per grain and s of a campaign's only string."""
    section, values = campaign.at(campaign.parameters())
    return scales.collision_rate(section, values)


PLANES: Final[Mapping[str, Plane]] = {
    plane.name: plane for plane in (Softening(), Heat(), Collapse(), Masses(), Scale())
}
"""Planes by name, in the order of a report."""


def points(
    plane: Plane, scenes: Mapping[str, tuple[SceneSection, Values]]
) -> Mapping[str, NDArray[np.float64]]:
    """Return where scenes lie in a plane, by name, (2,); those without them are left out."""
    found = {name: np.array(plane.point(*scene)) for name, scene in scenes.items()}
    return {name: place for name, place in found.items() if not np.isnan(place).any()}
