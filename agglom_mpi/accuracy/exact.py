"""A few hard spheres from collision to collision: what a simulation of them should find.

Written from the model alone and shared with no engine: plain Python, every pair, in numpy's long
double, which has 64 bits of mantissa where the processor has them.
"""

import itertools
import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Final

import numpy as np

IMAGES: Final = np.array(list(itertools.product((-1.0, 0.0, 1.0), repeat=3)), np.longdouble)
"""Of a sphere in a periodic box, in box edges; enough while nobody flies further than half one."""

Restitution = Callable[[Any, Any, Any], Any]
"""e of an approach speed in m/s, a reduced mass in kg and the smaller radius in m; 0 bonds."""


@dataclass
class Sphere:
    """A sphere at a time; `position` is not wrapped into the box."""

    position: Any
    velocity: Any
    radius: Any
    mass: Any


def fly(
    spheres: list[Sphere],
    restitution: Restitution,
    friction: float,
    half_width: float,
    end_time: float,
) -> int:
    """Bring spheres to `end_time` in s, in place; return how many impacts there were.

    Who is bonded to an earlier sphere of the list is taken out of it. `friction` is Coulomb's
    coefficient.
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
    """Return when in s the next pair touches, which, and the vector between them then."""
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
    """Return when |line + velocity t| falls to `reach` for each line, inf where it never does."""
    closing = -(lines @ velocity)
    outside = np.sum(lines**2, axis=1) - reach * reach
    discriminant = closing**2 - (velocity @ velocity) * outside
    delays = np.full(len(lines), np.inf, np.longdouble)
    meets = (closing > 0.0) & (discriminant > 0.0)
    delays[meets] = outside[meets] / (closing[meets] + np.sqrt(discriminant[meets]))
    return np.maximum(delays, 0.0)


def bounce(a: Sphere, b: Sphere, line: Any, restitution: Restitution, friction: float) -> bool:
    """Let two spheres bounce off each other; False if they bond instead  [A 4–5] [B 2.4–2.5]."""
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
    """Make a the sphere of both: at their centre of mass, with their momentum and volume."""
    mass = a.mass + b.mass
    a.position = a.position + b.mass / mass * line
    a.velocity = (a.mass * a.velocity + b.mass * b.velocity) / mass
    a.radius = np.cbrt(a.radius**3 + b.radius**3)
    a.mass = mass
