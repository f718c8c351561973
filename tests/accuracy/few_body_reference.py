"""Cases of a few hard spheres, and their exact trajectories from collision to collision.

The trajectories are written from the model alone and share nothing with an engine: plain Python,
every pair, in numpy's long double, which has 64 bits of mantissa where the processor has them.
"""

import itertools
import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]

HALF_WIDTH: Final = 0.01
RADIUS: Final = 1e-3
DIAMETER: Final = 2.0 * RADIUS
MASS: Final = 5000.0 * 4.0 / 3.0 * math.pi * RADIUS**3
END_TIME: Final = 0.01
SPEED: Final = 1.0
"""Speed of the first approach in m/s, or close to it; in END_TIME it crosses half the box."""

LONGEST_DELAY: Final = 1e-3
"""Longest random delay of a start in s: the published longest step of the adaptive engine."""

FRICTION: Final = 0.2
HEAD_ON_RESTITUTION: Final = 0.8

BONDING_SPEED: Final = 1.0
"""Approach speed of equal spheres in m/s at which they bond; it sets the hardness."""

# Nothing moves along an axis of the box.
_AXES: Final = np.linalg.qr(np.array([[2.0, 1.0, -1.0], [1.0, 3.0, 2.0], [0.5, -1.0, 2.0]]))[0].T

IMAGES: Final = np.array(list(itertools.product((-1.0, 0.0, 1.0), repeat=3)), np.longdouble)
"""Images of a sphere in a periodic box, in edges, (27, 3); enough for paths of half an edge."""

Restitution = Callable[[Any, Any, Any], Any]
"""e as a function of approach speed in m/s, reduced mass in kg, smaller radius in m; 0 bonds."""


@dataclass
class Sphere:
    """State of one sphere: m, m/s, m, kg; `position`, shape (3,), is not wrapped into the box."""

    position: Any
    velocity: Any
    radius: Any
    mass: Any


def exact_trajectory(
    spheres: list[Sphere],
    restitution: Restitution,
    friction: float,
    half_width: float,
    end_time: float,
) -> int:
    """Advance spheres to the end time in place; return the number of impacts.

    Of two that bond the later one is removed from the list.

    Parameters
    ----------
    spheres
        At the start.
    restitution
        Of every impact.
    friction
        Coulomb's coefficient.
    half_width
        Half the edge of the periodic cube in m.
    end_time
        In s.
    """
    left = np.longdouble(end_time)
    edge = 2.0 * np.longdouble(half_width)
    impacts = 0
    while True:
        delay, first, second, line = next_contact(spheres, edge)
        for sphere in spheres:
            sphere.position = sphere.position + min(delay, left) * sphere.velocity
        left -= delay
        if left < 0.0:
            return impacts
        impacts += 1
        if not bounce(spheres[first], spheres[second], line, restitution, friction):
            bond(spheres[first], spheres[second], line)
            del spheres[second]


def next_contact(spheres: list[Sphere], edge: Any) -> tuple[Any, int, int, Any]:
    """Return the next contact: delay in s, indices of the pair, the vector between them then."""
    best: tuple[Any, int, int, Any] = (np.longdouble(math.inf), -1, -1, None)
    for i, j in itertools.combinations(range(len(spheres)), 2):
        a, b = spheres[i], spheres[j]
        velocity = b.velocity - a.velocity
        apart = b.position - a.position
        lines = apart + edge * (IMAGES - np.round(apart / edge))
        delays = times_to_touch(lines, velocity, a.radius + b.radius)
        image = int(np.argmin(delays))
        if delays[image] < best[0]:
            best = delays[image], i, j, lines[image] + delays[image] * velocity
    return best


def times_to_touch(lines: Any, velocity: Any, reach: Any) -> Any:
    """Return the times in s until |line + velocity t| = `reach`, lines (n, 3); inf for never."""
    closing = -(lines @ velocity)
    outside = np.sum(lines**2, axis=1) - reach * reach
    discriminant = closing**2 - (velocity @ velocity) * outside
    delays = np.full(len(lines), np.inf, np.longdouble)
    meets = (closing > 0.0) & (discriminant > 0.0)
    delays[meets] = outside[meets] / (closing[meets] + np.sqrt(discriminant[meets]))
    return np.maximum(delays, 0.0)


def bounce(a: Sphere, b: Sphere, line: Any, restitution: Restitution, friction: float) -> bool:
    """Apply the impulse of an impact; return False if the two bond instead  [A 4–5] [B 2.4–2.5]."""
    normal = line / np.sqrt(line @ line)
    relative = a.velocity - b.velocity
    approach = relative @ normal
    reduced = a.mass * b.mass / (a.mass + b.mass)
    e = restitution(approach, reduced, min(a.radius, b.radius))
    if e <= 0.0:
        return False
    impulse = reduced * (1.0 + e) * approach
    slip = relative - approach * normal
    speed = np.sqrt(slip @ slip)
    push = impulse * normal
    if speed > 0.0:
        push = push + min(friction * impulse, reduced * speed) * slip / speed
    a.velocity = a.velocity - push / a.mass
    b.velocity = b.velocity + push / b.mass
    return True


def bond(a: Sphere, b: Sphere, line: Any) -> None:
    """Merge b into a: at their centre of mass, with their momentum and volume."""
    mass = a.mass + b.mass
    a.position = a.position + b.mass / mass * line
    a.velocity = (a.mass * a.velocity + b.mass * b.velocity) / mass
    a.radius = np.cbrt(a.radius**3 + b.radius**3)
    a.mass = mass


class InitialStates(NamedTuple):
    """States to start from, each of as many equal grains as its case has.

    Attributes
    ----------
    position, velocity
        Shape (runs, 3, grains), m and m/s.
    """

    position: Floats
    velocity: Floats


class FewBodyCase(NamedTuple):
    """Equal spheres whose trajectory is computed exactly.

    Attributes
    ----------
    name, description
        The description goes on after the name and a colon.
    position, velocity
        Shape (spheres, 3), m and m/s.
    restitution
        Constant coefficient, together with friction; None for the pressure law without friction,
        which also decides which pairs bond.
    """

    name: str
    description: str
    position: Floats
    velocity: Floats
    restitution: float | None


def _turned(rows: list[list[float]]) -> Floats:
    return np.asarray(np.array(rows) @ _AXES)


def _pair(
    name: str, description: str, offset: float, gap: float, centre: float, restitution: float
) -> FewBodyCase:
    """Return two spheres a `gap` in m apart that approach with impact parameter `offset` in m."""
    way = 0.5 * (math.sqrt(DIAMETER**2 - offset**2) + gap)
    position = _turned([[-way, 0.5 * offset, 0.0], [way, -0.5 * offset, 0.0]]) + centre
    velocity = _turned([[0.6, 0.0, 0.1], [-0.4, 0.0, 0.1]])
    if offset == 0.0:
        velocity = _turned([[0.5, 0.0, 0.0], [-0.5, 0.0, 0.0]])
    return FewBodyCase(name, description, position, velocity * SPEED, restitution)


def _third(way: float, aside: list[float]) -> list[float]:
    """Return a place near the path, after `way` in m, of a sphere that was struck at the origin."""
    return [way * 0.99, -way * 0.14 + aside[0], aside[1]]


def bouncing() -> list[FewBodyCase]:
    """Return the cases of constant restitution with friction."""
    d = DIAMETER
    rest = [0.0, 0.0, 0.0]
    ahead = [SPEED, 0.0, 0.0]
    cradle = [[1.5 * d * k, 0.0, 0.0] for k in (-2, -1, 0, 1, 2)]
    three = [[-1.95 * d, 0.3 * d, 0.0], rest, _third(2.0 * d, [0.4 * d, 0.3 * d])]
    pairs = [[-2.45 * d * k, 0.3 * d * k, z * d] for k in (1, 0) for z in (0.55, -0.55)]
    return [
        _pair("head-on", "two spheres head-on", 0.0, 1.5 * d, 0.0, HEAD_ON_RESTITUTION),
        _pair("oblique", "two that strike obliquely and rub", 0.5 * d, 1.5 * d, 0.0, 0.8),
        _pair(
            "across a corner",
            "the same through a corner of the periodic box",
            0.6 * d,
            d,
            HALF_WIDTH,
            0.7,
        ),
        FewBodyCase(
            "cradle of five",
            "five in a row, of which the first strikes and passes it on",
            _turned(cradle),
            _turned([ahead, *[rest] * 4]),
            0.9,
        ),
        FewBodyCase(
            "three in sequence",
            "one that strikes a second, which strikes a third, neither in line",
            _turned(three),
            _turned([ahead, rest, rest]),
            0.8,
        ),
        FewBodyCase(
            "two pairs",
            "two that fly side by side and strike two that rest side by side",
            _turned(pairs),
            _turned([ahead, ahead, rest, rest]),
            0.8,
        ),
    ]


def bonding() -> list[FewBodyCase]:
    """Return the case of the pressure law: two bond, and the aggregate bounces off a third."""
    d = DIAMETER
    position = [[-2.0 * d, 0.2 * d, 0.0], [0.0, 0.0, 0.0], [2.0 * d, 0.5 * d, 0.3 * d]]
    velocity = [[1.5 * SPEED, 0.0, 0.0], [0.0, 0.0, 0.0], [0.0, 0.0, 0.0]]
    return [
        FewBodyCase(
            "bond, then bounce",
            "two that bond, and then bounce off a third by the pressure law",
            _turned(position),
            _turned(velocity),
            None,
        )
    ]


@cache
def hardness() -> float:
    """Hardness in Pa for which X = m*w²/(4πβHb³) is 1 at `BONDING_SPEED`, β = 1."""
    return 0.5 * MASS * BONDING_SPEED**2 / (4.0 * math.pi * RADIUS**3)


def initial_states(case: FewBodyCase, delays: Floats) -> InitialStates:
    """Return the start of a case moved back along its velocities by each delay in s, (runs,)."""
    position = case.position[None] - delays[:, None, None] * case.velocity[None]
    edge = 2.0 * HALF_WIDTH
    position -= edge * np.floor((position + HALF_WIDTH) / edge)
    velocity = np.broadcast_to(case.velocity, position.shape)
    return InitialStates(
        np.ascontiguousarray(position.transpose(0, 2, 1)),
        np.ascontiguousarray(velocity.transpose(0, 2, 1)),
    )


def exact_restitution(case: FewBodyCase) -> Restitution:
    """Return the restitution of a case; that of the pressure law in closed form  [B 4.14]."""
    if case.restitution is not None:
        constant = case.restitution
        return lambda approach, reduced, radius: constant

    def closed_form(approach: Any, reduced: Any, radius: Any) -> Any:
        pressure = reduced * approach**2 / (4.0 * np.longdouble(math.pi) * radius**3 * hardness())
        return max(1.0 - np.sqrt(pressure), np.longdouble(0.0))

    return closed_form


def exact_end(
    case: FewBodyCase, starts: InitialStates, run: int
) -> tuple[NDArray[Any], NDArray[Any]]:
    """Return exact positions, not wrapped, and velocities at the end, each of shape (3, left)."""
    spheres = [
        Sphere(r, v, np.longdouble(RADIUS), np.longdouble(MASS))
        for r, v in zip(
            starts.position[run].T.astype(np.longdouble),
            starts.velocity[run].T.astype(np.longdouble),
            strict=True,
        )
    ]
    friction = FRICTION if case.restitution is not None else 0.0
    exact_trajectory(spheres, exact_restitution(case), friction, HALF_WIDTH, END_TIME)
    return (
        np.array([sphere.position for sphere in spheres]).T,
        np.array([sphere.velocity for sphere in spheres]).T,
    )
