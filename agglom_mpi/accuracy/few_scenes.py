"""Scenes of a few spheres whose trajectory is known: what they are, and where they end."""

import math
from functools import cache
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from agglom_mpi.accuracy.batch import Starts
from agglom_mpi.accuracy.exact import Restitution, Sphere, fly
from agglom_mpi.physics.contact import CompressionRecoveryDuration, ContactArea
from agglom_mpi.physics.friction import ConstantFriction
from agglom_mpi.physics.hardness import ConstantHardness
from agglom_mpi.physics.impact_solvers import BracketedRoot
from agglom_mpi.physics.restitution import (
    ConstantRestitution,
    ImpactLaws,
    PressureRestitution,
)
from agglom_mpi.simulation.boundary import Periodic
from agglom_mpi.simulation.initial_state import UniformX
from agglom_mpi.simulation.scene import Scene

Floats = NDArray[np.float64]

HALF_WIDTH: Final = 0.01
RADIUS: Final = 1e-3
DIAMETER: Final = 2.0 * RADIUS
MASS: Final = 5000.0 * 4.0 / 3.0 * math.pi * RADIUS**3
END_TIME: Final = 0.01
SPEED: Final = 1.0
"""Of the first approach in m/s, or close to it; in END_TIME it crosses half the box."""

LONGEST_DELAY: Final = 1e-3
"""Starts are delayed by up to this, in s: the published longest step of the adaptive engine."""

FRICTION: Final = 0.2
HEAD_ON_RESTITUTION: Final = 0.8

BONDING_SPEED: Final = 1.0
"""Approach speed of equal spheres in m/s at which they bond; it sets the hardness."""

# Nothing moves along an axis of the box.
_AXES: Final = np.linalg.qr(np.array([[2.0, 1.0, -1.0], [1.0, 3.0, 2.0], [0.5, -1.0, 2.0]]))[0].T


class FewBodies(NamedTuple):
    """Equal spheres, each at a place with a velocity, shape (spheres, 3), m and m/s.

    With `restitution` None the pressure law decides it, and who bonds; else friction is at work.
    """

    name: str
    position: Floats
    velocity: Floats
    restitution: float | None


def _turned(rows: list[list[float]]) -> Floats:
    return np.asarray(np.array(rows) @ _AXES)


def _pair(name: str, offset: float, gap: float, centre: float, restitution: float) -> FewBodies:
    """Two spheres a `gap` apart that pass each other at an `offset`, both in m."""
    way = 0.5 * (math.sqrt(DIAMETER**2 - offset**2) + gap)
    position = _turned([[-way, 0.5 * offset, 0.0], [way, -0.5 * offset, 0.0]]) + centre
    velocity = _turned([[0.6, 0.0, 0.1], [-0.4, 0.0, 0.1]])
    if offset == 0.0:
        velocity = _turned([[0.5, 0.0, 0.0], [-0.5, 0.0, 0.0]])
    return FewBodies(name, position, velocity * SPEED, restitution)


def _third(way: float, aside: list[float]) -> list[float]:
    """Place a sphere where one that was struck at the origin comes by after `way` in m."""
    return [way * 0.99, -way * 0.14 + aside[0], aside[1]]


def bouncing() -> list[FewBodies]:
    """Return the scenes of constant restitution with friction."""
    d = DIAMETER
    rest = [0.0, 0.0, 0.0]
    ahead = [SPEED, 0.0, 0.0]
    cradle = [[1.5 * d * k, 0.0, 0.0] for k in (-2, -1, 0, 1, 2)]
    three = [[-1.95 * d, 0.3 * d, 0.0], rest, _third(2.0 * d, [0.4 * d, 0.3 * d])]
    pairs = [[-2.45 * d * k, 0.3 * d * k, z * d] for k in (1, 0) for z in (0.55, -0.55)]
    return [
        _pair("head-on", 0.0, 1.5 * d, 0.0, HEAD_ON_RESTITUTION),
        _pair("oblique", 0.5 * d, 1.5 * d, 0.0, 0.8),
        _pair("across a corner", 0.6 * d, d, HALF_WIDTH, 0.7),
        FewBodies("cradle of five", _turned(cradle), _turned([ahead, *[rest] * 4]), 0.9),
        FewBodies("three in sequence", _turned(three), _turned([ahead, rest, rest]), 0.8),
        FewBodies("two pairs", _turned(pairs), _turned([ahead, ahead, rest, rest]), 0.8),
    ]


def bonding() -> list[FewBodies]:
    """Return the scene of the pressure law: two bond, and what they make bounces off a third."""
    d = DIAMETER
    position = [[-2.0 * d, 0.2 * d, 0.0], [0.0, 0.0, 0.0], [2.0 * d, 0.5 * d, 0.3 * d]]
    velocity = [[1.5 * SPEED, 0.0, 0.0], [0.0, 0.0, 0.0], [0.0, 0.0, 0.0]]
    return [FewBodies("bond, then bounce", _turned(position), _turned(velocity), None)]


@cache
def hardness() -> float:
    """Hardness in Pa for which X = m*w²/(4πβHb³) is 1 at `BONDING_SPEED`, β = 1."""
    return 0.5 * MASS * BONDING_SPEED**2 / (4.0 * math.pi * RADIUS**3)


def scene_of(bodies: FewBodies, engine: Any) -> Scene:
    """Return the typed scene; two types, one with constant restitution and one without."""
    value = bodies.restitution
    constant = value is not None
    laws = ImpactLaws(
        restitution=PressureRestitution() if value is None else ConstantRestitution(value),
        duration=None if constant else CompressionRecoveryDuration(1.0),
        contact_area=ContactArea(0.0, 1.0),
        hardness=None if constant else ConstantHardness(hardness()),
        friction=ConstantFriction(FRICTION) if constant else None,
        heating=None,
        reaction=None,
        fragmentation=None,
        solver=None if constant else BracketedRoot(),
        heat_capacity=math.inf,
    )
    return Scene(
        escape=Periodic(),
        velocities=UniformX(0.0),
        laws=laws,
        cooling=None,
        engine=engine,
        particles=len(bodies.position),
        half_width=HALF_WIDTH,
        radius=RADIUS,
        mass=MASS,
        temperature=300.0,
        end_time=END_TIME,
    )


def starts_of(bodies: FewBodies, delays: Floats) -> Starts:
    """Return the scene's start for each delay in s: everybody as far back as they fly in it."""
    position = bodies.position[None] - delays[:, None, None] * bodies.velocity[None]
    edge = 2.0 * HALF_WIDTH
    position -= edge * np.floor((position + HALF_WIDTH) / edge)
    velocity = np.broadcast_to(bodies.velocity, position.shape)
    return Starts(
        np.ascontiguousarray(position.transpose(0, 2, 1)),
        np.ascontiguousarray(velocity.transpose(0, 2, 1)),
    )


def exact_restitution(bodies: FewBodies) -> Restitution:
    """Return e as a function of the impact; of the pressure law in closed form  [B 4.14]."""
    if bodies.restitution is not None:
        constant = bodies.restitution
        return lambda approach, reduced, radius: constant

    def closed_form(approach: Any, reduced: Any, radius: Any) -> Any:
        pressure = reduced * approach**2 / (4.0 * np.longdouble(math.pi) * radius**3 * hardness())
        return max(1.0 - np.sqrt(pressure), np.longdouble(0.0))

    return closed_form


def exact_end(bodies: FewBodies, starts: Starts, run: int) -> tuple[NDArray[Any], NDArray[Any]]:
    """Return exact positions, not wrapped, and velocities at the end, shape (3, left)."""
    spheres = [
        Sphere(r, v, np.longdouble(RADIUS), np.longdouble(MASS))
        for r, v in zip(
            starts.position[run].T.astype(np.longdouble),
            starts.velocity[run].T.astype(np.longdouble),
            strict=True,
        )
    ]
    friction = FRICTION if bodies.restitution is not None else 0.0
    fly(spheres, exact_restitution(bodies), friction, HALF_WIDTH, END_TIME)
    return (
        np.array([sphere.position for sphere in spheres]).T,
        np.array([sphere.velocity for sphere in spheres]).T,
    )
