"""What holds of the event engine for any number, density, speed and size of spheres."""

import math
from typing import Any, NamedTuple

import numpy as np
import pytest
from event_runs import BUDGET, ESCAPES, bouncing, recorded, same_place, size_ratio
from hypothesis import HealthCheck, assume, given, settings
from hypothesis import strategies as st
from plain_python import cases
from scenes import (
    HALF,
    SMALL,
    ball_mass,
    breaking_event_periodic,
    grains_in,
    make_scene,
    merging_event_reentry,
    momentum,
    placed,
    radiation,
    run_from,
    state,
)

from agglom_mpi.physics.cooling import ExactCooling
from agglom_mpi.physics.hardness import ArrheniusHardness
from agglom_mpi.simulation.boundary import Periodic
from agglom_mpi.simulation.engines import EventDriven
from agglom_mpi.simulation.particles import (
    BREAKUPS,
    COLLISIONS,
    DISSIPATED,
    EXHAUSTED,
    MERGES,
    RADIATED,
    REACTION,
    SURFACE,
)

few = settings(
    max_examples=25,
    deadline=None,
    derandomize=True,
    suppress_health_check=[HealthCheck.too_slow, HealthCheck.filter_too_much],
)
NUMBERS = st.integers(2, 200)
SEEDS = st.integers(0, 2**32 - 1)
FRACTIONS = st.one_of(st.floats(-6.0, -1.0).map(lambda x: 10.0**x), st.floats(0.1, 0.3))
SPEEDS = st.floats(-6.0, 6.0).map(lambda x: 10.0**x)
ESCAPE = st.sampled_from(list(ESCAPES))
BOTH = pytest.mark.parametrize("escape", cases(ESCAPES, ["periodic"], pytest.mark.slow))
RESTITUTIONS = st.one_of(st.just(1.0), st.floats(0.2, 1.0))


class Gas(NamedTuple):
    """A bouncing scene and a state of it."""

    scene: Any
    positions: np.ndarray
    velocities: np.ndarray
    radii: np.ndarray

    def __repr__(self):
        laws = self.scene.laws
        return (
            f"{self.scene.escape} {laws.restitution} {laws.friction} N={len(self.radii)} "
            f"b/D={self.radii.min() / HALF:.3g}…{self.radii.max() / HALF:.3g} "
            f"v={np.abs(self.velocities).max():.3g} T={self.scene.end_time:.3g}"
        )

    def particles(self):
        return state(self.scene, self.positions, self.velocities, self.radii)


@st.composite
def gases(draw, most=200, largest=10.0, escapes=ESCAPE, restitutions=RESTITUTIONS):
    """Draw a bouncing scene and a state whose radii and masses spread over up to a decade."""
    number = draw(st.integers(2, most))
    fraction, speed = draw(FRACTIONS), draw(SPEEDS)
    scene = bouncing(
        draw(restitutions),
        draw(escapes),
        friction=draw(st.sampled_from([0.0, 0.4])),
        particles=number,
        size_ratio=size_ratio(min(fraction, 0.2)),
        end_time=1.0,
        speed=speed,
    )
    generator = np.random.default_rng(draw(SEEDS))
    spread = draw(st.sampled_from([1.0, 2.0, largest]))
    # The volume fraction is kept; overlaps at the start are part of the test.
    radii = spread ** generator.uniform(-1.0, 0.0, number)
    radii *= scene.radius / np.cbrt(np.mean(radii**3))
    radii = np.minimum(radii, 0.45 * HALF)
    positions = generator.uniform(-HALF, HALF, (number, 3))
    if spread == 1.0:
        positions = placed(scene, draw(SEEDS)).position.T
    velocities = speed * generator.normal(size=(number, 3))
    # As long as an average sphere takes for a few collisions, or for some boxes if it has none.
    density = number / (2.0 * HALF) ** 3
    flight = min(4.0 * HALF, 1.0 / (density * 4.0 * math.pi * float(np.mean(radii**2))))
    scene = scene._replace(end_time=draw(st.floats(0.1, 4.0)) * flight / speed)
    return Gas(scene, positions, velocities, radii)


def overlapping_and_approaching(scene, particles):
    """Pairs that overlap and approach, beyond rounding."""
    n = int(particles.size[0])
    low, high = np.triu_indices(n, 1)
    r, v = particles.position.T, particles.velocity.T
    d = r[high] - r[low]
    if isinstance(scene.escape, Periodic.Numbers):
        d -= 2.0 * HALF * np.rint(d / (2.0 * HALF))
    distance = np.linalg.norm(d, axis=1)
    reach = particles.radius[low] + particles.radius[high]
    relative = v[high] - v[low]
    closing = np.sum(d * relative, axis=1) / np.maximum(distance, 1e-300)
    speed = np.abs(v[:n]).max(initial=0.0)
    depth = 1e-9 * np.maximum(reach, 1e-3 * HALF)
    return np.flatnonzero((distance < reach - depth) & (closing < -1e-9 * speed))


def kinetic(particles):
    """Kinetic energy in J in the centre-of-mass frame, and sum of m|v| there in kg m/s."""
    n = int(particles.size[0])
    m = particles.mass[:n]
    v = particles.velocity[:, :n] - (momentum(particles) / m.sum())[:, None]
    return 0.5 * float(m @ np.sum(v**2, axis=0)), float(m @ np.linalg.norm(v, axis=0))


@BOTH
def test_what_bounces_keeps_momentum_and_books_what_it_loses(escape):
    few(given(gases(escapes=st.just(escape)))(assert_books_what_it_loses))()


def assert_books_what_it_loses(gas):
    scene, positions, velocities, radii = gas
    particles = state(scene, positions, velocities, radii)
    before, (energy, impetus) = momentum(particles), kinetic(particles)
    out = recorded(scene, particles)
    finished = out.time == scene.end_time
    # A light sphere jammed between heavy ones collapses at any e < 1; no budget suffices for that.
    assert finished or scene.laws.restitution.value < 1.0
    n = int(particles.size[0])
    assert n == scene.particles
    assert np.all(np.isfinite(particles.position))
    assert np.all(np.isfinite(particles.velocity))
    assert np.all(np.abs(particles.position) <= HALF)
    assert np.linalg.norm(momentum(particles) - before) <= 1e-10 * impetus
    lost = energy - kinetic(particles)[0]
    assert abs(lost - out.ledger.energy[DISSIPATED]) <= 1e-10 * energy
    assert lost >= -1e-10 * energy
    assert np.all(np.diff(out.times) >= 0.0)
    assert not finished or len(overlapping_and_approaching(scene, particles)) == 0


@st.composite
def aggregating(draw):
    """Draw a scene that merges, and perhaps breaks and cools, of kernels that others use."""
    breaks = draw(st.booleans())
    if breaks:
        laws = breaking_event_periodic(**SMALL).laws
        laws = laws._replace(
            hardness=ArrheniusHardness.Numbers(10.0 ** draw(st.floats(8, 11)), 700.0)
        )
    else:
        laws = merging_event_reentry(10.0 ** draw(st.floats(4, 11)), **SMALL).laws
    number = draw(NUMBERS)
    speed = 10.0 ** draw(st.floats(-1.0, 2.0))
    scene = make_scene(
        laws,
        EventDriven.Numbers(BUDGET),
        ESCAPES["periodic" if breaks else "reentry"],
        number,
        size_ratio(min(draw(FRACTIONS), 0.2)),
        0.0,
        cooling=ExactCooling(radiation()) if breaks else None,
        speed=speed,
    )
    density = number / (2.0 * HALF) ** 3
    flight = min(4.0 * HALF, 1.0 / (density * 4.0 * math.pi * scene.radius**2))
    return scene._replace(end_time=draw(st.floats(0.5, 10.0)) * flight / speed), draw(SEEDS)


@pytest.mark.slow
@few
@given(aggregating())
def test_what_merges_and_breaks_keeps_mass_momentum_grains_and_energy(drawn):
    scene, seed = drawn
    particles = placed(scene, seed)
    if scene.laws.fragmentation is not None:
        particles = roomy(particles)
    before, (energy, impetus) = momentum(particles), kinetic(particles)
    start = particles.temperature[0]
    ledger, time = run_from(scene, particles)
    assert ledger.counts[EXHAUSTED] == 0
    assert time == scene.end_time
    n = int(particles.size[0])
    for values in (particles.position, particles.velocity):
        assert np.all(np.isfinite(values[:, :n]))
    assert np.all(np.isfinite(particles.temperature[:n]))
    assert grains_in(scene, particles).sum() == scene.particles
    assert math.isclose(particles.mass[:n].sum(), scene.particles * scene.mass, rel_tol=1e-12)
    masses = [ball_mass(radius) for radius in particles.radius[:n]]
    np.testing.assert_allclose(particles.mass[:n], masses, rtol=1e-10)
    assert ledger.counts[COLLISIONS] >= ledger.counts[MERGES]
    assert n >= scene.particles - ledger.counts[MERGES]
    assert n == scene.particles - ledger.counts[MERGES] or ledger.counts[BREAKUPS] > 0
    assert np.linalg.norm(momentum(particles) - before) <= 1e-10 * impetus
    capacity = scene.laws.heat_capacity
    heat = capacity * float(particles.mass[:n] @ (particles.temperature[:n] - start))
    flows = ledger.energy
    balance = kinetic(particles)[0] - energy + heat
    balance += flows[RADIATED] + flows[SURFACE] - flows[REACTION]
    thermal = capacity * scene.particles * scene.mass * start  # differences of this round
    scale = energy + flows[REACTION] + abs(flows[RADIATED]) + flows[SURFACE]
    assert abs(balance) <= 1e-10 * scale + 1e-14 * thermal
    assert len(overlapping_and_approaching(scene, particles)) == 0


def roomy(particles):
    """The same particles with room for as many pieces again."""
    grown = []
    for values in particles:
        if values is None:
            grown.append(None)
            continue
        shape = (*values.shape[:-1], 2 * values.shape[-1]) if values.size > 1 else values.shape
        larger = np.zeros(shape, values.dtype)
        larger[..., : values.shape[-1]] = values
        grown.append(larger)
    return type(particles)(*grown)


POWERS = st.sampled_from([-30, -7, -1, 1, 4, 22])


@BOTH
def test_units_by_powers_of_two_do_not_change_a_bit(escape):
    few(given(gases(escapes=st.just(escape)), POWERS, POWERS)(assert_same_in_other_units))()


def assert_same_in_other_units(gas, length, time):
    scene, positions, velocities, radii = gas
    particles = state(scene, positions, velocities, radii)
    out = recorded(scene, particles)
    long, late = 2.0**length, 2.0**time
    other = scene._replace(
        half_width=scene.half_width * long,
        radius=scene.radius * long,
        end_time=scene.end_time * late,
    )
    scaled = state(other, positions * long, velocities * long / late, radii * long)
    scaled.mass[:] = [ball_mass(radius) for radius in radii]
    again = recorded(other, scaled)
    np.testing.assert_array_equal(again.pairs, out.pairs)
    np.testing.assert_array_equal(again.times, out.times * late)
    np.testing.assert_array_equal(again.ledger.counts, out.ledger.counts)
    np.testing.assert_array_equal(scaled.position, particles.position * long)
    np.testing.assert_array_equal(scaled.velocity, particles.velocity * long / late)


def settled(gas):
    """Keep the spheres of a drawn gas that overlap no other in the periodic box.

    Overlaps at the start collide at once, in an order that depends on numbering.
    """
    scene, positions, velocities, radii = gas
    kept = []
    for i in range(len(radii)):
        d = positions[kept] - positions[i]
        d -= 2.0 * HALF * np.rint(d / (2.0 * HALF))
        if np.all(np.linalg.norm(d, axis=1) > (radii[kept] + radii[i]) * (1.0 + 1e-6)):
            kept.append(i)
    assume(len(kept) >= 2)
    scene = scene._replace(particles=len(kept))
    return Gas(scene, positions[kept], velocities[kept], radii[kept])


NUDGE = 1e-13
"""Relative change of the start, about 1e3 roundings, whose consequences show what is chaos."""


def foreseeable(gas):
    """A run, its end, how many of its collisions a nudge leaves alone, and whether the end too.

    Left alone means that times change by less than 1e-9, so a rounding changes them by 1e-12. There
    is one more with each collision: where the n-th follows within n times that, as in a collapse,
    roundings say which of them come.
    In periodic boxes: who re-enters onto two at once may hit either of them.
    """
    particles = gas.particles()
    run = recorded(gas.scene, particles)
    assume(run.time == gas.scene.end_time)  # what collapses collides on roundings in the end
    generator = np.random.default_rng(0)
    nudged = gas._replace(
        positions=gas.positions + NUDGE * HALF * generator.normal(size=gas.positions.shape)
    ).particles()
    np.clip(nudged.position, -HALF, HALF, out=nudged.position)
    other = recorded(gas.scene, nudged)
    both = min(len(run.times), len(other.times))
    alike = np.all(run.pairs[:both] == other.pairs[:both], axis=1)
    alike &= np.abs(other.times[:both] - run.times[:both]) <= 1e-9 * run.times[:both] + 1e-300
    alike[1:] &= np.diff(run.times[:both]) > 1e-12 * np.arange(1, both) * run.times[1:both]
    known = both if np.all(alike) else int(np.argmin(alike))
    ends = known == len(run.times) == len(other.times)
    ends = ends and same_place(nudged.position - particles.position, 1e-9 * HALF)
    return run, particles, known, ends


PERIODIC = gases(escapes=st.just("periodic"))


def assert_alike(known, run, again, slots=None):
    """The same collisions up to `known`, where `slots` says how they were renumbered.

    A drift of tenfold the speed rounds places forty times as much as they are nudged less a
    thousand times, and the one direction of the nudge may be a lucky one by as much again: times
    agree to 1e-9 for each collision so far, in each of which places are rounded anew.
    """
    pairs = run.pairs[:known] if slots is None else np.sort(slots[run.pairs[:known]], axis=1)
    np.testing.assert_array_equal(again.pairs[:known], pairs)
    differences = np.abs(again.times[:known] - run.times[:known])
    assert np.all(differences <= 1e-9 * np.arange(1, known + 1) * run.times[:known])


def assert_same_end(position, velocity, rows):
    assert same_place(rows.position - position, 1e-8 * HALF)
    np.testing.assert_allclose(rows.velocity, velocity, atol=1e-6 * np.abs(velocity).max())


@few
@given(PERIODIC, SEEDS)
def test_the_numbering_does_not_matter(gas, seed):
    gas = settled(gas)
    run, particles, known, ends = foreseeable(gas)
    order = np.random.default_rng(seed).permutation(len(gas.radii))
    shuffled = gas._replace(
        positions=gas.positions[order], velocities=gas.velocities[order], radii=gas.radii[order]
    ).particles()
    again = recorded(gas.scene, shuffled)
    assert_alike(known, run, again, np.argsort(order))
    if ends:
        assert len(again.times) == known
        assert_same_end(particles.position[:, order], particles.velocity[:, order], shuffled)


@few
@given(PERIODIC, st.integers(0, 2), st.permutations([0, 1, 2]))
def test_mirror_images_and_other_axes_end_as_the_original_does(gas, mirrored, axes):
    gas = settled(gas)
    run, particles, known, ends = foreseeable(gas)
    signs = np.ones(3)
    signs[mirrored] = -1.0
    other = gas._replace(
        positions=(gas.positions * signs)[:, axes], velocities=(gas.velocities * signs)[:, axes]
    ).particles()
    again = recorded(gas.scene, other)
    assert_alike(known, run, again)
    if ends:
        assert len(again.times) == known
        turned = ((r * signs[:, None])[axes] for r in (particles.position, particles.velocity))
        assert_same_end(*turned, other)


@few
@given(PERIODIC, st.floats(-3.0, 1.0), SEEDS)
def test_a_periodic_box_looks_the_same_to_a_moving_observer(gas, exponent, seed):
    """The drift is tenfold the speed at most: the velocities round by 1e-15 of themselves."""
    gas = settled(gas)
    run, particles, known, ends = foreseeable(gas)
    generator = np.random.default_rng(seed)
    drift = np.abs(gas.velocities).max() * 10.0**exponent * generator.uniform(-1.0, 1.0, 3)
    shift = generator.uniform(-HALF, HALF, 3)
    places = gas.positions + shift
    places -= 2.0 * HALF * np.rint(places / (2.0 * HALF))
    moving = gas._replace(positions=places, velocities=gas.velocities + drift).particles()
    again = recorded(gas.scene, moving)
    assert_alike(known, run, again)
    if ends:
        assert len(again.times) == known
        moving.position[:] -= (drift * run.time + shift)[:, None]
        moving.velocity[:] -= drift[:, None]
        assert_same_end(particles.position, particles.velocity, moving)


def test_most_of_what_is_drawn_collides_and_can_be_foreseen():
    counts = []

    @few
    @given(PERIODIC)
    def count(gas):
        run, _, known, ends = foreseeable(settled(gas))
        counts.append((len(gas.radii), len(run.times), known, ends))

    count()
    assert np.median([known for _, _, known, _ in counts]) >= 1
