"""Hard spheres from event to event: plain numpy, every pair and every image looked at.

A sphere flies straight until it takes part in an event, so a contact is a root of a quadratic.
The earliest contact of each pair stands in a matrix; the rows of spheres that an event changed
are found anew, and in a periodic box all of them before a pair can get out of the images' sight.

What an event is:

* Two spheres that touch and approach collide at the time they touch; two that overlap and
  approach collide now; two that recede, or pass with a gap, do not collide.
* A pair just resolved is not resolved again at that time unless one of the two changed since.
* Contacts at the same time: the lowest (i, j) first. A contact comes before a re-entry.
* Everything up to and at `end_time` happens.

Compare collisions early: of 100 elastic spheres, two runs from positions that differ by roundings
have the same times to 1e-9 of the time for 4 collisions per sphere at φ = 0.03, and 13 at 0.2.
"""

import itertools
import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

IMAGES = np.array(list(itertools.product((-1.0, 0.0, 1.0), repeat=3)))
NEAREST = 13
"""Where in IMAGES the image without a shift stands."""

Impact = Callable[[float, float, float, float, float], float]
"""e = impact(approach speed, mass i, mass j, radius i, radius j); e = 0 bonds the two."""


class Collision(NamedTuple):
    """Slots i < j as they were at the start: what i and j make when they merge keeps slot i."""

    time: float
    i: int
    j: int
    kind: str
    """ "bounce" or "merge"."""


SAME = 1e-9
"""Relative difference of equal times of early collisions, see above."""


def untied(collisions):
    """How many collisions come before the first that shares its time and a sphere with another.

    Who re-enters may land on two spheres at once; which of the two is hit first, and whether it is
    before a face is crossed again, is anybody's choice.
    """
    for k, (one, two) in enumerate(itertools.pairwise(collisions)):
        if two.time - one.time <= SAME * two.time and {one.i, one.j} & {two.i, two.j}:
            return k
    return len(collisions)


@dataclass
class Result:
    """State at `time`: end_time, or the time of the last collision that `most` allowed.

    A slot that a merge emptied is not alive; its numbers mean nothing.
    """

    time: float
    collisions: list[Collision]
    position: np.ndarray
    velocity: np.ndarray
    radius: np.ndarray
    mass: np.ndarray
    alive: np.ndarray


def run_reference(
    positions,
    velocities,
    radii,
    masses,
    half_width,
    end_time,
    impact: Impact,
    friction=0.0,
    escape="periodic",
    most=None,
) -> Result:
    """Fly and collide from time 0 to end_time, or until `most` collisions have happened.

    escape "periodic": contacts with the nearest image, which needs sums of radii up to half_width.
    escape "reentry": who reaches a face goes on from the opposite one, and faces hide contacts.
    friction is Coulomb's coefficient, against the slip of two spheres that do not spin.
    """
    gas = EventReference(positions, velocities, radii, masses, half_width, escape)
    gas.run(end_time, impact, friction, math.inf if most is None else most)
    return Result(
        time=gas.now,
        collisions=gas.collisions,
        position=gas.positions(),
        velocity=gas.velocity,
        radius=gas.radius,
        mass=gas.mass,
        alive=gas.alive,
    )


def contact_delays(separation, velocity, reach):
    """How long until |separation + velocity·t| falls to reach, for vectors along the last axis."""
    approach = -np.sum(separation * velocity, axis=-1)  # −½ d|separation|²/dt
    distance = np.sqrt(np.sum(separation**2, axis=-1))
    closeness = np.sum(velocity**2, axis=-1) * reach**2 - np.sum(
        np.cross(separation, velocity) ** 2, axis=-1
    )  # |velocity|²(reach² − impact parameter²)
    overlaps = distance <= reach
    meets = (approach > 0.0) & (overlaps | (closeness > 0.0))
    root = np.sqrt(np.maximum(closeness, 0.0))
    squared_gap = np.where(overlaps, 0.0, (distance - reach) * (distance + reach))
    return np.where(meets, squared_gap / np.where(meets, approach + root, 1.0), np.inf)


class EventReference:
    def __init__(self, positions, velocities, radii, masses, half_width, escape):
        if escape not in ("periodic", "reentry"):
            raise ValueError(f"no such escape: {escape}")
        self.periodic = escape == "periodic"
        self.D = float(half_width)
        self.now = 0.0
        self.position = np.array(positions, dtype=float)  # where each was at its time `since`
        self.velocity = np.array(velocities, dtype=float)
        self.radius = np.array(radii, dtype=float)
        self.mass = np.array(masses, dtype=float)
        self.since = np.zeros(len(self.mass))
        self.alive = np.ones(len(self.mass), dtype=bool)
        self.collisions = []
        if not self.periodic and np.any(np.abs(self.position) > self.D):
            raise ValueError("with re-entry every sphere starts inside the box")
        self.check_reach()

    def check_reach(self):
        two_largest = np.sort(self.radius[self.alive])[-2:]
        if self.periodic and len(two_largest) == 2 and two_largest.sum() > self.D:
            raise ValueError("two spheres are too large for one nearest image")

    # what is where

    def positions(self):
        """Where all particles are now, inside the box."""
        r = self.position + self.velocity * (self.now - self.since)[:, None]
        if self.periodic:
            return r - 2.0 * self.D * np.floor((r + self.D) / (2.0 * self.D))
        return np.clip(r, -self.D, self.D)  # rounding may lead past a face

    def line(self, start, end):
        """Vector between two positions, to the nearest image in a periodic box."""
        d = end - start
        return d - 2.0 * self.D * np.round(d / (2.0 * self.D)) if self.periodic else d

    # when what happens

    def look_at_all(self):
        size = len(self.mass)
        self.contact = np.full((size, size), np.inf)  # above the diagonal: when i and j touch
        self.face = np.full((size, 3), np.inf)  # when i reaches a face along an axis
        self.sight = math.inf
        self.look_at(range(size))

    def look_at(self, changed, resolved=None):
        """Find the events of those who changed; of a pair just resolved the nearest image waits."""
        r = self.positions()
        for i in changed:
            times = self.contact_times(r, i, resolved)
            self.contact[:i, i] = times[:i]
            self.contact[i, i + 1 :] = times[i + 1 :]
            self.face[i] = np.inf if self.periodic else self.face_times(r, i)
        # The nearest image is within D along each axis, those outside IMAGES are 3D away or more.
        # Radii add up to D at most, so nobody gets there before they moved 2D: look again at D.
        fastest = np.max(np.abs(self.velocity[self.alive]), initial=0.0)
        if self.periodic and fastest > 0.0:
            self.sight = min(self.sight, self.now + self.D / (2.0 * fastest))

    def contact_times(self, r, i, resolved):
        if not self.alive[i]:
            return np.full(len(self.mass), np.inf)
        separation = self.line(r[i], r)[None, :, :]
        if self.periodic:
            separation = separation + 2.0 * self.D * IMAGES[:, None, :]
        nearest = NEAREST if self.periodic else 0
        velocity = np.broadcast_to(self.velocity - self.velocity[i], separation.shape)
        delays = contact_delays(separation, velocity, self.radius[i] + self.radius)
        if resolved is not None and i in resolved:
            delays[nearest, sum(resolved) - i] = np.inf
        return np.where(self.alive, self.now + delays.min(axis=0), np.inf)

    def face_times(self, r, i):
        if not self.alive[i]:
            return np.inf
        times = np.full(3, np.inf)
        for axis, v in enumerate(self.velocity[i]):
            if v != 0.0:
                way = self.D - r[i, axis] if v > 0.0 else self.D + r[i, axis]
                times[axis] = self.now + way / abs(v)
        return times

    def run(self, end_time, impact, friction, most):
        self.look_at_all()
        while len(self.collisions) < most:
            pair = np.unravel_index(np.argmin(self.contact), self.contact.shape)
            crossing = np.unravel_index(np.argmin(self.face), self.face.shape)
            contact, face = float(self.contact[pair]), float(self.face[crossing])
            following = min(contact, face, self.sight)
            if following > end_time:
                self.now = end_time
                return
            self.now = following
            if contact == following:
                self.collide(int(pair[0]), int(pair[1]), impact, friction)
            elif face == following:
                self.reenter(*crossing)
            else:
                self.look_at_all()

    # what happens

    def put(self, i, position, velocity):
        """Let i go on from a position with a velocity."""
        self.position[i], self.velocity[i], self.since[i] = position, velocity, self.now

    def reenter(self, i, axis):
        position = self.positions()[i]
        position[axis] = -math.copysign(self.D, self.velocity[i, axis])
        self.put(i, position, self.velocity[i])
        self.look_at([i])

    def collide(self, i, j, impact, friction):
        r = self.positions()
        line = self.line(r[i], r[j])
        n = line / np.linalg.norm(line)
        w = float((self.velocity[i] - self.velocity[j]) @ n)
        if w <= 0.0:  # grazing: no approach but for rounding
            self.look_at([i, j], resolved=(i, j))
            return
        e = impact(w, self.mass[i], self.mass[j], self.radius[i], self.radius[j])
        if e == 0.0:
            self.merge(i, j, r[i], line)
        else:
            self.bounce(i, j, r, n, w, e, friction)

    def bounce(self, i, j, r, n, w, e, friction):
        reduced = self.mass[i] * self.mass[j] / (self.mass[i] + self.mass[j])
        normal = reduced * (1.0 + e) * w
        impulse = normal * n
        slip = self.velocity[i] - self.velocity[j] - w * n
        slip_speed = np.linalg.norm(slip)
        if friction > 0.0 and slip_speed > 0.0:
            impulse = impulse + min(friction * normal, reduced * slip_speed) * slip / slip_speed
        self.put(i, r[i], self.velocity[i] - impulse / self.mass[i])
        self.put(j, r[j], self.velocity[j] + impulse / self.mass[j])
        self.collisions.append(Collision(self.now, i, j, "bounce"))
        self.look_at([i, j], resolved=(i, j))

    def merge(self, i, j, start, line):
        total = self.mass[i] + self.mass[j]
        share = self.mass[j] / total
        self.put(
            i, start + share * line, self.velocity[i] * (1.0 - share) + self.velocity[j] * share
        )
        self.mass[i] = total
        self.radius[i] = np.cbrt(self.radius[i] ** 3 + self.radius[j] ** 3)
        self.alive[j] = False
        self.check_reach()
        self.collisions.append(Collision(self.now, i, j, "merge"))
        self.look_at([i, j])
