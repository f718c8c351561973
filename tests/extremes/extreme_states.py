"""Particles put by hand where a random placement never puts them, and a kernel that runs them."""

import json
from typing import Any, NamedTuple

import numpy as np
from extreme_scenes import decades
from hypothesis import strategies as st

from agglom_mpi.outcome import FAILED, OUTCOME
from agglom_mpi.physics.restitution import LastingContact
from agglom_mpi.simulation.engines import EventDriven
from agglom_mpi.simulation.particles import empty_particles, particle_type
from agglom_mpi.simulation.sample import carry_to_end

PLENTY = 10**6
"""Events per particle: a light sphere meets two heavy ones √(mass ratio) times and more."""

FULLEST = 0.35
"""Volume fraction up to which there is room to move; without any, impacts never end."""

LAYOUTS = ("chain", "lattice", "faces", "overlapping", "apart", "coinciding")
MOTIONS = ("gas", "gas", "inwards", "decades", "one", "alike")


class Arranged(NamedTuple):
    """A scene of a drawn campaign and a state of its own."""

    drawn: Any
    scene: Any
    layout: str
    positions: np.ndarray
    velocities: np.ndarray
    radii: np.ndarray
    temperatures: np.ndarray
    grains: np.ndarray

    def __repr__(self):
        state = {name: getattr(self, name).tolist() for name in self._fields[3:]}
        return f"{self.layout} {self.scene} {json.dumps(state)}"

    def particles(self):
        """Return the state, with room for all grains to lie apart, and for as many gaps."""
        count, capacity = len(self.radii), 2 * int(self.grains.sum())
        density = self.drawn.values["density"]
        remembers = isinstance(self.scene.laws.restitution, LastingContact.Numbers)
        particles = empty_particles(particle_type(True, True, remembers, True), capacity)
        particles.size[0] = particles.labels_given[0] = count
        particles.label[:] = np.arange(capacity)
        particles.position[:, :count] = self.positions.T
        particles.velocity[:, :count] = self.velocities.T
        particles.radius[:count] = self.radii
        particles.mass[:count] = density * 4.0 / 3.0 * np.pi * self.radii**3
        particles.temperature[:count] = self.temperatures
        particles.grains[:count] = self.grains
        return particles

    def carried(self):
        """Run the state to the end of its scene: the record, the particles, the ledger."""
        particles, out = self.particles(), np.zeros(1, OUTCOME)
        out["state"] = FAILED
        ledger = carry_to_end(self.scene, particles, None, out)
        return out[0], particles, ledger


def laid_out(layout, number, radii, half, generator):
    """Positions of up to `number` spheres, and their radii."""
    if layout == "lattice":
        side = 2 if number < 14 else 3
        radius = 0.8 * half / side  # room to move: without any, impacts never end
        axis = 2.0 * radius * np.arange(side) - 0.5 * half
        places = np.stack(np.meshgrid(axis, axis, axis), axis=-1).reshape(-1, 3)
        return places, np.full(len(places), radius)
    if layout == "chain":
        radii = radii * min(1.0, 0.8 * half / radii.sum())
        along = -half + np.cumsum(2.0 * radii) - radii
        places = np.zeros((number, 3))
        places[:, generator.integers(3)] = np.clip(along, -half, half)
        return places, radii
    places = generator.uniform(-half, half, (number, 3))
    if layout == "faces":
        on = generator.random((number, 3)) < 0.5
        places[on] = half * generator.choice([-1.0, 1.0], np.count_nonzero(on))
    if layout == "coinciding":
        places[1:] = places[generator.integers(0, 2, number - 1)]
    if layout == "apart":
        kept = []
        for i in range(number):
            d = places[kept] - places[i]
            d -= 2.0 * half * np.rint(d / (2.0 * half))
            if np.all(np.linalg.norm(d, axis=1) > radii[kept] + radii[i]):
                kept.append(i)
        places, radii = places[kept], radii[kept]
    return places, radii


def set_going(motion, places, half, speed, generator):
    """Velocities of spheres at `places`."""
    count = len(places)
    gas = speed * generator.uniform(-1.0, 1.0, (count, 3))
    match motion:
        case "inwards":
            return -speed * places / half
        case "decades":
            return gas * 10.0 ** -generator.uniform(0.0, 12.0, (count, 1))
        case "one":
            return np.where(np.arange(count)[:, None] == 0, gas, 0.0)
        case "alike":
            return np.broadcast_to(gas[0], (count, 3)).copy()
    return gas


@st.composite
def arranged(draw, kind, periodic, most=24):
    """Draw a scene and a state of spheres that touch, overlap, coincide or sit on faces."""
    drawn = draw(kind)
    generator = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    campaign = drawn.campaign()
    scene = campaign.scene.build(campaign.parameters())
    half, speed = scene.half_width, scene.velocities.relative_speed
    number, layout = draw(st.integers(2, most)), draw(st.sampled_from(LAYOUTS))
    spread, largest = draw(st.sampled_from([0, 0, 1, 3])), 0.49 * half * draw(decades(-2, 0))
    # A light sphere among heavy ones that touch it is hit millions of times.
    spread = min(spread, 1) if layout == "chain" else spread
    radii = largest * 10.0 ** -generator.uniform(0.0, spread, number)
    fraction = 4.0 / 3.0 * np.pi * np.sum(radii**3) / (2.0 * half) ** 3
    radii *= min(1.0, (FULLEST / fraction) ** (1.0 / 3.0))
    positions, radii = laid_out(layout, number, radii, half, generator)
    velocities = set_going(draw(st.sampled_from(MOTIONS)), positions, half, speed, generator)
    velocities += draw(st.sampled_from([0.0, 1.0, 1e6] if periodic else [0.0, 1.0])) * speed
    count = len(radii)
    grains = np.ones(count, np.int64)
    if draw(st.booleans()):
        grains = generator.integers(1, 50, count)
    if draw(st.integers(0, 31)) == 31:
        grains[np.argmax(radii)] = 300
    temperatures = np.full(count, scene.temperature)
    if draw(st.booleans()):
        temperatures *= 10.0 ** generator.uniform(-3.0, 3.0, count)
    end_time = scene.end_time
    if speed > 0.0:
        end_time = draw(st.sampled_from([0.0, 0.03, 0.3, 1.0, 3.0, 10.0])) * half / speed
    laws = scene.laws
    budget = PLENTY
    if isinstance(laws.restitution, LastingContact.Numbers):
        lasting = draw(st.sampled_from([0.0, 1e-6, 1e-3])) * end_time
        laws = laws._replace(restitution=laws.restitution._replace(contact_time=lasting))
        budget = PLENTY if lasting > 0.0 or laws.restitution.value == 1.0 else 2000
    scene = scene._replace(
        laws=laws,
        engine=EventDriven.Numbers(budget),
        particles=int(grains.sum()),
        radius=float(radii.min()),
        end_time=end_time,
    )
    return Arranged(drawn, scene, layout, positions, velocities, radii, temperatures, grains)
