"""A scene as compiled kernels see it: a NamedTuple of submodels, `None` for what is left out."""

import math
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
import numpy.typing as npt

from agglom_mpi.compilation import Submodel
from agglom_mpi.physics import cooling as cool
from agglom_mpi.physics.contact_area import ContactArea
from agglom_mpi.physics.duration import CompressionRecoveryDuration, MeanSpeedDuration
from agglom_mpi.physics.fragmentation import OwnEnergyFragmentation, PairEnergyFragmentation
from agglom_mpi.physics.friction import ConstantFriction, RestitutionScaledFriction
from agglom_mpi.physics.hardness import ArrheniusHardness, ConstantHardness
from agglom_mpi.physics.heating import OwnEnergy, PairSplit
from agglom_mpi.physics.reaction import ContactAreaReaction
from agglom_mpi.physics.restitution import (
    ConstantRestitution,
    ContactTimeRestitution,
    ImpactLaws,
    PressureRestitution,
)
from agglom_mpi.physics.scales import end_time, grain_mass, grain_radius
from agglom_mpi.physics.solvers import PublishedIteration, RootFinder
from agglom_mpi.simulation.box import Periodic, Reentry
from agglom_mpi.simulation.velocities import SpreadVelocities, UniformX
from agglom_mpi.variables import NAMES

if TYPE_CHECKING:
    from agglom_mpi.campaign.scene import SceneModel


class FixedSteps(NamedTuple):
    """`steps` equal time steps over the run  [A]."""

    steps: int


class AdaptiveSteps(NamedTuple):
    """Steps of the smallest gap over approach speed within [floor, ceiling], s  [B 6.14]."""

    floor: float
    ceiling: float


class EventDriven(NamedTuple):
    """Exact times; at most `budget` events per grain, crossings of cells included."""

    budget: int


class Scene(NamedTuple):
    """Everything that one sample is a function of, random numbers aside.

    `particles` equal grains of `radius` in m and `mass` in kg in a cube of half-width
    `half_width` in m, for `end_time` in s from `temperature` in K.
    """

    escape: Submodel
    velocities: Submodel
    laws: ImpactLaws
    cooling: Submodel | None
    engine: Submodel
    particles: int
    half_width: float
    radius: float
    mass: float
    temperature: float
    end_time: float


def build_scene(model: "SceneModel", parameters: npt.ArrayLike, engine: Any = None) -> Scene:
    """Make the typed scene of one parameter string.

    The event engine has no time steps and cools exactly, whatever the scene's `integration` is;
    the steppers integrate as the scene says. A ValueError says why a scene cannot be simulated.

    Parameters
    ----------
    model
        The `scene` section of a campaign.
    parameters
        The ten variables in SI units, shape (10,), in the order of `agglom_mpi.variables`.
    engine
        An engine section to use instead of the scene's own.
    """
    value = dict(zip(NAMES, np.asarray(parameters, dtype=float).tolist(), strict=True))
    heats = model.heating.law != "none"
    chosen = engine or model.engine
    return Scene(
        escape=Periodic() if model.escape == "periodic" else Reentry(),
        velocities=_velocities(model.velocities, value),
        laws=_impact_laws(model, value),
        cooling=_cooling(model.cooling, value, chosen.law != "event"),
        engine=_engine(chosen),
        particles=model.particles,
        half_width=model.half_width,
        radius=grain_radius(model, value),
        mass=grain_mass(model, value),
        temperature=value["temperature"] if heats or not _missing(value["temperature"]) else 0.0,
        end_time=end_time(model, value),
    )


def _missing(value: float) -> bool:
    return math.isnan(value)


def _velocities(model: Any, value: dict[str, float]) -> NamedTuple:
    speed = value["relative_speed"]
    if model.law == "uniform_x":
        return UniformX(speed)
    return SpreadVelocities(speed, (model.mean[0], model.mean[1], model.mean[2]), model.transverse)


def _impact_laws(model: "SceneModel", value: dict[str, float]) -> ImpactLaws:
    pressure = model.restitution.law == "pressure"
    durations = {
        "mean_speed": MeanSpeedDuration,
        "compression_recovery": CompressionRecoveryDuration,
    }
    frictions = {"restitution_scaled": RestitutionScaledFriction, "constant": ConstantFriction}
    heatings = {"pair_split": PairSplit, "own_energy": OwnEnergy}
    breakages = {"pair_energy": PairEnergyFragmentation, "own_energy": OwnEnergyFragmentation}
    friction = frictions.get(model.friction.law)
    heating = heatings.get(model.heating.law)
    breaking = breakages.get(model.fragmentation.law)
    reacts = model.reaction.law != "none"
    return ImpactLaws(
        restitution=_restitution(model.restitution),
        duration=durations[model.duration.law](model.duration.length_ratio) if pressure else None,
        contact_area=ContactArea(model.contact_area.initial, model.contact_area.final),
        hardness=_hardness(model, value) if pressure else None,
        friction=friction(value["friction"]) if friction else None,
        heating=heating() if heating else None,
        reaction=ContactAreaReaction(value["reaction_heat"]) if reacts else None,
        fragmentation=breaking(value["surface_energy"]) if breaking else None,
        solver=_solver(model.solver) if pressure else None,
        heat_capacity=value["heat_capacity"] if heating else math.inf,
    )


def _restitution(
    model: Any,
) -> PressureRestitution | ConstantRestitution | ContactTimeRestitution:
    if model.law == "pressure":
        return PressureRestitution()
    if model.contact_time > 0.0:
        return ContactTimeRestitution(model.value, model.contact_time)
    return ConstantRestitution(model.value)


def _hardness(model: "SceneModel", value: dict[str, float]) -> ConstantHardness | ArrheniusHardness:
    if model.hardness.law == "arrhenius":
        return ArrheniusHardness(value["hardness"], value["activation_energy"])
    return ConstantHardness(value["hardness"])


def _solver(model: Any) -> RootFinder | PublishedIteration:
    if model.law == "root":
        return RootFinder()
    return PublishedIteration(model.tolerance, model.cap)


def _cooling(
    model: Any, value: dict[str, float], steps: bool
) -> cool.Exact | cool.ForwardEuler | None:
    if model.law == "none":
        return None
    law: Submodel
    if model.law == "radiation":
        law = cool.RadiativeCooling(
            model.emissivity,
            model.surroundings,
            model.convection,
            model.ambient,
            cool.equilibrium_temperature(
                model.emissivity, model.surroundings, model.convection, model.ambient
            ),
        )
    else:
        law = cool.QuarticCooling(value["density"], value["heat_capacity"], value["temperature"])
    return cool.ForwardEuler(law) if steps and model.integration == "euler" else cool.Exact(law)


def _engine(model: Any) -> EventDriven | FixedSteps | AdaptiveSteps:
    if model.law == "event":
        return EventDriven(model.budget)
    if model.law == "fixed":
        return FixedSteps(model.steps)
    return AdaptiveSteps(model.floor, model.ceiling)
