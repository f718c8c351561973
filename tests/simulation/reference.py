"""Both published steppers once more: plain Python, all pairs.

Written from what the steppers mean: [A] each particle in turn collides with its nearest neighbour
of the step's start, and merges at once; whoever lost that neighbour to a merge looks again, and a
particle that a merge made is a neighbour from then on. [B] every pair of nearest neighbours
collides once, merges follow after all pairs, then the step to the next contact is chosen.
"""

import math
from dataclasses import dataclass

import numpy as np
from scenes import temperatures_in

from agglom_mpi.physics.contact import MeanSpeedDuration
from agglom_mpi.physics.restitution import ConstantRestitution
from agglom_mpi.simulation.boundary import Periodic
from agglom_mpi.simulation.engines import FixedSteps


@dataclass
class Ball:
    r: np.ndarray
    v: np.ndarray
    b: float
    m: float
    T: float
    alive: bool = True


class Reference:
    def __init__(self, scene, particles):
        self.scene = scene
        self.D = scene.half_width
        self.periodic = isinstance(scene.escape, Periodic.Numbers)
        temperatures = temperatures_in(scene, particles)
        self.balls = [
            Ball(
                particles.position[:, i].copy(),
                particles.velocity[:, i].copy(),
                particles.radius[i],
                particles.mass[i],
                temperatures[i],
            )
            for i in range(int(particles.size[0]))
        ]
        self.collisions = self.merges = self.steps = 0

    def run(self):
        if isinstance(self.scene.engine, FixedSteps.Numbers):
            step = self.scene.end_time / self.scene.engine.steps
            for _ in range(self.scene.engine.steps):
                self.resolve_in_turn()
                self.move(step)
        else:
            left = self.scene.end_time
            while left > 1e-15 * self.scene.end_time:
                step = min(self.resolve_together(), left)
                self.move(step)
                left -= step
        return self

    # what is where

    def line(self, i, j):
        d = self.balls[j].r - self.balls[i].r
        if self.periodic:
            d = np.where(d > self.D, d - 2.0 * self.D, np.where(d < -self.D, d + 2.0 * self.D, d))
        return d

    def distance(self, i, j):
        return float(np.linalg.norm(self.line(i, j)))

    def nearest_neighbours(self):
        r = np.array([ball.r for ball in self.balls])
        found = []
        for i in range(len(r)):
            d = np.abs(r - r[i])
            if self.periodic:
                d = np.minimum(d, 2.0 * self.D - d)
            distances = np.linalg.norm(d, axis=1)
            distances[i] = math.inf
            j = int(np.argmin(distances))
            found.append((j, float(distances[j])) if len(r) > 1 else (None, math.inf))
        return found

    def nearest(self, i):
        others = [j for j, ball in enumerate(self.balls) if ball.alive and j != i]
        if not others:
            return None, math.inf
        j = min(others, key=lambda k: self.distance(i, k))
        return j, self.distance(i, j)

    def reach(self, i, j):
        return self.balls[i].b + self.balls[j].b

    def approach(self, i, j):
        n = self.line(i, j)
        return float((self.balls[i].v - self.balls[j].v) @ n / np.linalg.norm(n))

    def put_inside(self, ball):
        for axis in range(3):
            if abs(ball.r[axis]) > self.D:
                if self.periodic:
                    ball.r[axis] = (ball.r[axis] + self.D) % (2.0 * self.D) - self.D
                else:
                    ball.r[axis] = -math.copysign(self.D, ball.r[axis])

    def move(self, step):
        self.balls = [ball for ball in self.balls if ball.alive]
        for ball in self.balls:
            ball.r = ball.r + step * ball.v
            self.put_inside(ball)
        self.steps += 1

    # impacts

    def pressure(self, i, j):
        """X = I(e=0)/(2πb²H)."""
        a, c, laws = self.balls[i], self.balls[j], self.scene.laws
        m, b = a.m * c.m / (a.m + c.m), min(a.b, c.b)
        force = m * self.approach(i, j) ** 2 / (2.0 * laws.duration.length_ratio * b)
        return force / (2.0 * math.pi * b * b * laws.hardness.hardness)

    def bonds(self, i, j):
        laws = self.scene.laws
        if isinstance(laws.restitution, ConstantRestitution.Numbers):
            return laws.restitution.value == 0.0
        return self.pressure(i, j) >= 1.0

    def restitution(self, i, j):
        laws = self.scene.laws
        if isinstance(laws.restitution, ConstantRestitution.Numbers):
            return laws.restitution.value
        root = math.sqrt(self.pressure(i, j))
        if isinstance(laws.duration, MeanSpeedDuration.Numbers):
            return (1.0 - root) / (1.0 + root)
        return 1.0 - root

    def bounce(self, i, j):
        a, c, laws = self.balls[i], self.balls[j], self.scene.laws
        before = 0.5 * a.m * a.v @ a.v + 0.5 * c.m * c.v @ c.v
        e, w, distance = self.restitution(i, j), self.approach(i, j), self.distance(i, j)
        n = self.line(i, j) / distance
        m = a.m * c.m / (a.m + c.m)
        impulse = m * (1.0 + e) * w * n
        slip = a.v - c.v - w * n
        speed = np.linalg.norm(slip)
        if laws.friction is not None and speed > 0.0:
            rubbing = min(laws.friction.friction * m * (1.0 + e) * w, m * speed)
            impulse = impulse + rubbing * slip / speed
        a.v = a.v - impulse / a.m
        c.v = c.v + impulse / c.m
        if laws.heating is not None:
            loss = before - 0.5 * a.m * a.v @ a.v - 0.5 * c.m * c.v @ c.v
            area = (1.0 - e) * math.pi * min(a.b, c.b) ** 2  # a₀ = 0, a_f = 1
            for ball in (a, c):
                heat = 0.5 * loss + laws.reaction.reaction_heat * area
                ball.T += heat / (ball.m * laws.heat_capacity)
        overlap = 1.0 - distance / (a.b + c.b)
        if overlap > 0.0:  # [A 8]
            for ball in (a, c):
                speed = np.linalg.norm(ball.v)
                if speed > 0.0:
                    ball.r = ball.r + overlap * ball.b * ball.v / speed
                    self.put_inside(ball)
        self.collisions += 1

    def merge(self, i, j):
        """Make balls i and j one ball in place i."""
        a, c, laws = self.balls[i], self.balls[j], self.scene.laws
        m = a.m + c.m
        relative = a.v - c.v
        loss = 0.5 * a.m * c.m / m * relative @ relative
        a.r = a.r + c.m / m * self.line(i, j)
        self.put_inside(a)
        a.v = (a.m * a.v + c.m * c.v) / m
        if laws.heating is not None:
            heat = loss + 2.0 * laws.reaction.reaction_heat * math.pi * min(a.b, c.b) ** 2
            a.T = (a.m * a.T + c.m * c.T) / m + heat / (m * laws.heat_capacity)
        a.m = m
        a.b = (a.b**3 + c.b**3) ** (1.0 / 3.0)
        c.alive = False
        self.collisions += 1
        self.merges += 1

    def mended(self, i, partner, distance, changed):
        """Nearest neighbour of i after merges changed some balls in this step."""
        if partner is None or i in changed or partner in changed or not self.balls[partner].alive:
            return self.nearest(i)
        for j in changed:
            if j != i and self.balls[j].alive and self.distance(i, j) < distance:
                return self.nearest(i)
        return partner, distance

    def resolve_in_turn(self):
        partners = self.nearest_neighbours()
        changed = set()
        for i in range(len(self.balls)):
            if not self.balls[i].alive:
                continue
            j, found = self.mended(i, *partners[i], changed) if changed else partners[i]
            if j is None or max(found, self.distance(i, j)) > self.reach(i, j):
                continue
            if self.approach(i, j) <= 0.0:
                continue
            if self.bonds(i, j):
                self.merge(i, j)
                changed.add(i)
            else:
                self.bounce(i, j)

    def resolve_together(self):
        """Contacts of one adaptive step; the length of the step, s."""
        partners = self.nearest_neighbours()
        bonded, seen = [], set()
        for i, (j, found) in enumerate(partners):
            if j is None or frozenset((i, j)) in seen:
                continue
            seen.add(frozenset((i, j)))
            if max(found, self.distance(i, j)) > self.reach(i, j) or self.approach(i, j) <= 0.0:
                continue
            if self.bonds(i, j):
                bonded.append((i, j))
            else:
                self.bounce(i, j)
        clusters = {i: i for i in range(len(self.balls))}
        changed = set()
        for i, j in bonded:
            low, high = sorted((clusters[i], clusters[j]))
            if low != high:
                self.merge(low, high)
                changed.add(low)
                for k, owner in clusters.items():
                    if owner == high:
                        clusters[k] = low
        step = self.scene.engine.ceiling
        for i, (j, found) in enumerate(partners):
            if not self.balls[i].alive:
                continue
            j, found = self.mended(i, j, found, changed) if changed else (j, found)
            if j is not None and self.approach(i, j) > 0.0:
                gap = max(0.0, self.distance(i, j) - self.reach(i, j))
                step = min(step, gap / self.approach(i, j))
        return max(step, self.scene.engine.floor)
