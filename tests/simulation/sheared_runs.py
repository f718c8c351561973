"""Sheared boxes: scenes, and a reference that looks at all images of all pairs at each event."""

import itertools

import numpy as np
from scenes import BUDGET, CONSTANT, HALF, make_scene

from agglom_mpi.physics.restitution import ConstantRestitution
from agglom_mpi.simulation.boundary import Shear
from agglom_mpi.simulation.engines import EventDriven

SIDE = 2.0 * HALF


def sheared(rate, restitution=1.0, laws=CONSTANT, **options):
    """Return a scene of bouncing grains in shear."""
    laws = laws._replace(restitution=ConstantRestitution.Numbers(restitution))
    return make_scene(laws, EventDriven.Numbers(BUDGET), Shear.Numbers(rate), **options)


def in_flow(rate, positions, velocities):
    """Return velocities with the mean flow in them."""
    velocities = np.array(velocities, dtype=float)
    velocities[:, 0] += rate * np.asarray(positions)[:, 1]
    return velocities


def boxed(rate, position, velocity, time):
    """Return a place and velocity as those of the image in the box."""
    position, velocity = np.array(position), np.array(velocity)
    above = np.floor((position[1] + HALF) / SIDE)
    position[0] -= above * rate * SIDE * time
    velocity[0] -= above * rate * SIDE
    position[1] -= above * SIDE
    return position - SIDE * np.floor((position + HALF) / SIDE), velocity


class Reference:
    """Hard spheres of equal mass in shear; positions are those in the unbounded flow, never moved.

    Image (a, b, c) of a sphere is at r + ((a + b rate t) L, b L, c L) and has b rate L more u.
    """

    def __init__(self, rate, positions, velocities, radius, restitution):
        self.rate, self.radius, self.restitution = rate, radius, restitution
        self.r, self.v = np.array(positions, dtype=float), np.array(velocities, dtype=float)
        self.time, self.count = 0.0, 0

    def images(self, i, j):
        """Return ways from i to images of j, and their relative velocities, (n, 3) each."""
        away, speed = self.r[j] - self.r[i], self.v[j] - self.v[i]
        b0 = -round(away[1] / SIDE)
        ways, speeds = [], []
        for b, c in itertools.product((b0 - 1, b0, b0 + 1), (-1, 0, 1)):
            way, relative = away.copy(), speed.copy()
            way += (b * self.rate * SIDE * self.time, b * SIDE, (c - round(away[2] / SIDE)) * SIDE)
            relative[0] += b * self.rate * SIDE
            near = -round(way[0] / SIDE)
            for a in range(near - 2, near + 3):
                ways.append(way + np.array([a * SIDE, 0.0, 0.0]))
                speeds.append(relative)
        return np.array(ways), np.array(speeds)

    def soonest(self, i, j, skip):
        """Return the flight to the earliest contact of i with an image of j, and its place."""
        ways, speeds = self.images(i, j)
        closing = np.einsum("ij,ij->i", ways, speeds)
        excess = np.einsum("ij,ij->i", ways, ways) - 4.0 * self.radius**2
        square = np.einsum("ij,ij->i", speeds, speeds)
        inside = closing**2 - square * excess
        good = (closing < 0.0) & (inside > 0.0)
        if skip:  # just collided: the image in contact recedes
            good &= excess > 1e-9 * self.radius**2
        with np.errstate(all="ignore"):
            times = np.where(good, np.maximum(excess, 0.0) / (np.sqrt(inside) - closing), np.inf)
        best = int(np.argmin(times))
        return times[best], ways[best], speeds[best]

    def run(self, end, longest):
        """Run to a time; flights are cut at `longest`, so that no image is out of sight."""
        n, last = len(self.r), None
        while self.time < end:
            first = (min(longest, end - self.time), None)
            for i, j in itertools.combinations(range(n), 2):
                time, way, speed = self.soonest(i, j, (i, j) == last)
                if time < first[0]:
                    first = (time, (i, j, way + time * speed, speed))
            self.r += first[0] * self.v
            self.time += first[0]
            last = None
            if first[1] is not None:
                i, j, way, speed = first[1]
                normal = way / np.linalg.norm(way)
                impulse = 0.5 * (1.0 + self.restitution) * (normal @ speed) * normal
                self.v[i] += impulse
                self.v[j] -= impulse
                self.count += 1
                last = (i, j)

    def in_box(self):
        """Return places and velocities of the images in the box, (n, 3) each."""
        images = [boxed(self.rate, r, v, self.time) for r, v in zip(self.r, self.v, strict=True)]
        return np.array([r for r, _ in images]), np.array([v for _, v in images])
