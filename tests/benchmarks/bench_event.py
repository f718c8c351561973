"""Speed of the event engine, beside the steppers and beside REBOUND where that is installed.

Run with `pytest tests/benchmarks/bench_event.py -m benchmark -s` (about five minutes, half of them
REBOUND's), or one part of it with `-k gas`, `merging`, `published`, `million`, `oversize`.
One thread each. The engine is timed alone: placement and measuring are set aside.
"""

import math
import resource
import statistics
import time
from pathlib import Path

import numpy as np
import pytest
import rebound_peer as peer

from agglom_mpi.compilation.kernels import kernel
from agglom_mpi.config.loading import load_campaign
from agglom_mpi.physics.contact import ContactArea
from agglom_mpi.physics.restitution import ConstantRestitution, ImpactLaws
from agglom_mpi.physics.velocities import SpreadVelocities
from agglom_mpi.simulation import sample  # noqa: F401  (registers the engines)
from agglom_mpi.simulation.boundary import Periodic
from agglom_mpi.simulation.engines import EventDriven
from agglom_mpi.simulation.particles import (
    COLLISIONS,
    EXHAUSTED,
    STEPS,
    Particles,
    new_ledger,
    new_particles,
)
from agglom_mpi.simulation.sample import place_grains
from agglom_mpi.simulation.scene import Scene, new_engine_state, run_to_end
from agglom_mpi.variables import TEN
from agglom_mpi.verbs.simulate import simulate

ENGINE = EventDriven.Numbers(100_000)
HALF = 0.01
SPEED = 4.0
REPEATS = 5

PACKINGS = (0.2, 0.03)
COUNTS = (100, 1000, 10_000)
RESTITUTION = 0.9
EACH = 20
"""Collisions per particle, expected of a homogeneous gas."""

SHARES = {0.2: (0.1, 0.01), 0.03: (0.3, 0.05)}
"""REBOUND's steps for each packing, radii over the speed of a component: a rough and a fine one.

The fine one misses less than 1 % of the collisions of an elastic gas (0.9 and 0.6 %, each ±0.2 %,
of the exact count over 12 starts of 4000 grains), the rough one 8 %. With losses a count does not
tell: what a late hit finds turned away from the line of centres dissipates too little, and the
hotter gas collides more often.
"""

FINER = 4
MISSING_COUNT, MISSING_EACH, MISSING_SEEDS = 1000, 10, 5
MERGING_SHARES = (0.2, 0.05)
LEGS = 20
"""Parts of a run, each with a REBOUND step of its own."""

ROWS = {
    "accretion_2003": (
        (4.326, 0.633, 6141.898, 67.188e6, 1279.542, 0.307, 330.652, 707.351, 5940883.989),
        ("event", "fixed:200"),
    ),
    "agglomeration_2004": (
        (184.688, 0.79041, 6652.7, 265480, 1796.3, 0.0013456, 502.18, 352.41, 1.7765e6, 8.3685e15),
        ("event", "adaptive"),
    ),
}
"""First rows of [A table 1] and [B table 1], and the engines to compare."""

JOBS = Path(__file__).parents[2] / "jobs"
GIANT = 100.0
SPARSE = 1e-4
"""Volume fraction of the grains around the oversize particle."""


def make_scene(count, radius, restitution, end_time, half=HALF):
    laws = ImpactLaws(
        ConstantRestitution.Numbers(restitution),
        None,
        ContactArea.Numbers(0.0, 1.0),
        *[None] * 6,
        heat_capacity=math.inf,
    )
    return Scene(
        escape=Periodic.Numbers(),
        velocities=SpreadVelocities.Numbers((0.0, 0.0, 0.0), 1.0, SPEED),
        laws=laws,
        cooling=None,
        engine=ENGINE,
        particles=count,
        half_width=half,
        radius=radius,
        mass=1e-6,
        temperature=0.0,
        end_time=end_time,
    )


def make_gas(packing, count, restitution, each):
    radius = 2.0 * HALF * (0.75 * packing / math.pi / count) ** (1.0 / 3.0)
    scene = make_scene(count, radius, restitution, 0.0)
    return scene._replace(end_time=time_of(scene, packing, each))


def time_of(scene, packing, each):
    """Time in s of `each` collisions per particle in a homogeneous gas that cools (Haff).

    Enskog's rate with the pair correlation of Carnahan and Starling; the temperature falls by
    (1 − e²)/3 of itself per collision of a particle.
    """
    density = scene.particles / (2.0 * scene.half_width) ** 3
    correlation = (1.0 - packing / 2.0) / (1.0 - packing) ** 3
    area = 4.0 * scene.radius**2
    thermal = SPEED / math.sqrt(3.0)
    rate = 4.0 * math.sqrt(math.pi) * density * area * correlation * thermal
    loss = (1.0 - scene.laws.restitution.value**2) / 3.0
    if loss == 0.0:
        return each / rate
    return 2.0 / (loss * rate) * math.expm1(loss * each / 2.0)


def start(scene, random):
    particles = new_particles(scene, scene.particles)
    place_grains(scene, random, particles, np.zeros(1, np.uint8))
    return particles


@kernel
def engine_of_scene(scene, particles, ledger, engine_state, abort):
    run_to_end(scene, particles, ledger, engine_state, abort)


def run_engine(scene, particles, abort):
    ledger = new_ledger()
    engine_state = new_engine_state(scene.engine, scene, particles.mass.size)
    engine_of_scene(scene, particles, ledger, engine_state, abort)
    return ledger


def warm_up():
    scene = make_gas(0.03, 100, RESTITUTION, 1)
    run_engine(scene, start(scene, np.random.default_rng(1)), np.zeros(1, np.uint8))


def run(scene, particles):
    """Seconds, ledger and final particles of a run from a copy of `particles`."""
    final = Particles(*(array if array is None else array.copy() for array in particles))
    begin = time.perf_counter()
    ledger = run_engine(scene, final, np.zeros(1, np.uint8))
    seconds = time.perf_counter() - begin
    assert ledger.counts[EXHAUSTED] == 0
    return seconds, ledger, final


def median_run(scene, particles, repeats=REPEATS):
    runs = [run(scene, particles) for _ in range(repeats)]
    return statistics.median(seconds for seconds, _, _ in runs), *runs[0][1:]


def component_speed(particles):
    """Standard deviation of a component of the velocities, in the centre-of-mass frame, m/s."""
    velocity = particles.velocity[:, : particles.size[0]]
    return float(np.sqrt(np.mean(np.var(velocity, axis=1))))


def peer_grains(scene, particles):
    side = 2.0 * scene.half_width
    return peer.Grains(particles.position.T, particles.velocity.T, scene.radius, scene.mass, side)


def peer_ends(scene, packing, each):
    return [time_of(scene, packing, each * leg / LEGS) for leg in range(1, LEGS + 1)]


def print_row(widths, row):
    print("".join(f"{entry:<{width}}" for entry, width in zip(row, widths, strict=True)))


GAS_WIDTHS = (6, 8, 15, 9, 8, 19, 15, 18, 13, 10)
GAS_TITLES = (
    "phi",
    "N",
    "code",
    "step",
    "steps",
    "collisions/particle",
    "  collisions/s",
    "  events/collision",
    "  T/T(event)",
    "  time",
)


def print_gas(packing, count):
    scene = make_gas(packing, count, RESTITUTION, EACH)
    particles = start(scene, np.random.default_rng(1))
    seconds, ledger, final = median_run(scene, particles)
    impacts, events = int(ledger.counts[COLLISIONS]), int(ledger.counts[STEPS])
    row = (packing, count, "event", "-", "-", f"{2.0 * impacts / count:.2f}")
    measures = (f"  {impacts / seconds:.0f}", f"  {events / impacts:.2f}", "  1", "  1")
    print_row(GAS_WIDTHS, row + measures)
    if peer.rebound:
        for share in SHARES[packing]:
            print_gas_of_peer(scene, particles, packing, share, component_speed(final))


def print_gas_of_peer(scene, particles, packing, share, speed):
    """Print REBOUND's row; each of its runs is compared with one of ours right before it."""
    grains, ends = peer_grains(scene, particles), peer_ends(scene, packing, EACH)
    count = scene.particles
    own, runs = [], []
    for _ in range(REPEATS if count < COUNTS[-1] else 1):
        own.append(run(scene, particles)[0])
        runs.append(peer.bounce(grains, RESTITUTION, ends, share))
    found = runs[0]
    rate = found.collisions / statistics.median(each.seconds for each in runs)
    ratio = statistics.median(each.seconds / ours for each, ours in zip(runs, own, strict=True))
    row = (packing, count, peer.title(), share, found.steps, f"{2 * found.collisions / count:.2f}")
    heat = (found.speed / speed) ** 2
    print_row(GAS_WIDTHS, (*row, f"  {rate:.0f}", "", f"  {heat:.3f}", f"  {ratio:.1f}"))


@pytest.mark.benchmark
def test_print_the_speed_in_a_granular_gas():
    warm_up()
    print(f"\ngranular gas, e = {RESTITUTION}, to the time of about {EACH} collisions per particle")
    print(
        "step: radii over the spread of a velocity component, anew at each collision per particle"
    )
    print("T/T(event): temperature at the end over the exact one; time: over the event engine's")
    print(f"median of {REPEATS} runs; REBOUND with {COUNTS[-1]} grains: one run")
    print_row(GAS_WIDTHS, GAS_TITLES)
    for packing in PACKINGS:
        for count in COUNTS:
            print_gas(packing, count)
    print_missed()


def print_missed():
    if not peer.rebound:
        print(peer.MISSING)
        return
    print(
        f"\n{peer.title()}: collisions missed in an elastic gas, N = {MISSING_COUNT}, of those ",
        end="",
    )
    print(
        f"found with the last step, {FINER} times finer, and of the exact; {MISSING_SEEDS} starts"
    )
    widths = (8, 9, 22, 20, 20)
    print_row(widths, ("phi", "step", "collisions/particle", "of the finest", "of the exact"))
    for packing in PACKINGS:
        shares = (*SHARES[packing], SHARES[packing][-1] / FINER)
        counts = np.array([elastic_counts(packing, shares, s) for s in range(MISSING_SEEDS)])
        for share, found in zip(("exact", *shares), counts.T, strict=True):
            of_finest, of_exact = missed(found, counts[:, -1]), missed(found, counts[:, 0])
            print_row(widths, (packing, share, f"{found.mean():.3f}", of_finest, of_exact))


def missed(found, truth):
    """Return the share missed and its standard error, as text, from counts of the same starts."""
    share = 1.0 - found.mean() / truth.mean()
    error = (found - truth).std(ddof=1) / math.sqrt(len(found)) / truth.mean()
    return f"{share:.2%} +- {error:.2%}"


def elastic_counts(packing, shares, seed):
    """Collisions per particle: exact, and REBOUND's with steps of these shares."""
    scene = make_gas(packing, MISSING_COUNT, 1.0, MISSING_EACH)
    particles = start(scene, np.random.default_rng(seed))
    grains = peer_grains(scene, particles)
    runs = [peer.bounce(grains, 1.0, [scene.end_time], share).collisions for share in shares]
    _, ledger, _ = run(scene, particles)
    exact = int(ledger.counts[COLLISIONS])
    return [2.0 * found / MISSING_COUNT for found in (exact, *runs)]


@pytest.mark.benchmark
def test_print_the_speed_of_merging():
    warm_up()
    scene = make_gas(0.2, 1000, 0.0, 1)
    particles = start(scene, np.random.default_rng(1))
    scene = scene._replace(end_time=time_when_left(scene, particles, 100))
    seconds, ledger, final = median_run(scene, particles)
    print(f"\nmerging, e = 0, phi = 0.2, 1000 grains, for {scene.end_time * 1e3:.4g} ms")
    widths = (15, 7, 8, 8, 12, 10)
    print_row(widths, ("code", "step", "steps", "left", "mass", "ms"))
    left, mass = int(final.size[0]), float(np.sum(final.mass[: final.size[0]])) / 1e-3
    print_row(widths, ("event", "-", "-", left, f"{mass:.6f}", f"{seconds * 1e3:.3f}"))
    print(f"({int(ledger.counts[STEPS])} events)")
    if not peer.rebound:
        print(peer.MISSING)
        return
    ends = [scene.end_time * math.expm1(3.0 * k / LEGS) / math.expm1(3.0) for k in range(1, 21)]
    for share in MERGING_SHARES:
        grains = peer_grains(scene, particles)
        runs = [peer.merge(grains, ends, share) for _ in range(REPEATS)]
        milliseconds = statistics.median(each.seconds for each in runs) * 1e3
        found = runs[0]
        row = (peer.title(), share, found.steps, found.left)
        print_row(widths, (*row, f"{found.mass / 1e-3:.6f}", f"{milliseconds:.3f}"))


def time_when_left(scene, particles, wanted):
    """Time in s at which about `wanted` particles are left, by bisection of its logarithm."""
    lower, upper = 1e-3 * scene.end_time, 1e3 * scene.end_time
    for _ in range(30):
        middle = math.sqrt(lower * upper)
        _, _, final = run(scene._replace(end_time=middle), particles)
        if final.size[0] > wanted:
            lower = middle
        else:
            upper = middle
    return upper


@pytest.mark.benchmark
def test_print_the_time_of_published_samples():
    print("\nfirst rows of the papers' tables; whole samples, processor time")
    widths = (22, 12, 10, 14, 14, 14)
    print_row(widths, ("job", "engine", "samples", "median ms", "collisions", "mean b/b0"))
    for job, (row, engines) in ROWS.items():
        campaign = load_campaign(JOBS / f"{job}.yaml")
        for engine in engines:
            found = many_samples(campaign, named(row), engine)
            milliseconds = statistics.median(outcome.cpu_seconds for outcome in found) * 1e3
            impacts = statistics.mean(outcome.collisions for outcome in found)
            growth = statistics.mean(outcome.mean_radius_ratio for outcome in found)
            measures = (f"{milliseconds:.3f}", f"{impacts:.1f}", f"{growth:.4f}")
            print_row(widths, (job, engine, len(found), *measures))


def named(row):
    return dict(zip(TEN.names, row, strict=False))


def many_samples(campaign, parameters, engine):
    """Return outcomes of samples for about three seconds, but of 20 to 1000."""
    simulate(campaign, parameters, 0, engine)
    found = []
    begin = time.perf_counter()
    while len(found) < 20 or (time.perf_counter() - begin < 3.0 and len(found) < 1000):
        found.append(simulate(campaign, parameters, len(found), engine))
    return found


@pytest.mark.benchmark
def test_print_the_cost_of_a_million():
    warm_up()
    small = make_gas(0.2, 1000, RESTITUTION, 1)
    seconds, ledger, _ = median_run(small, start(small, np.random.default_rng(1)), 21)
    each = seconds / int(ledger.counts[COLLISIONS])
    scene = make_gas(0.2, 1_000_000, RESTITUTION, 1)
    begin = time.perf_counter()
    particles = start(scene, np.random.default_rng(1))
    placed = time.perf_counter() - begin
    held = resident()
    begin = time.perf_counter()
    ledger = run_engine(scene, particles, np.zeros(1, np.uint8))
    seconds = time.perf_counter() - begin
    grown = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024 - held
    impacts = int(ledger.counts[COLLISIONS])
    own = sum(array.nbytes for array in particles if array is not None)
    print(f"\na million grains, phi = 0.2, e = {RESTITUTION}: {impacts} collisions")
    print(f"{seconds:.2f} s and {placed:.2f} s for the placement")
    print(f"{seconds / impacts * 1e6:.3f} us per collision, with 1000 grains {each * 1e6:.3f} us:")
    print(f"{seconds / impacts / each:.2f} times as much (both with starting the engine)")
    print(f"bytes per particle: {own / 1e6:.0f} the state, at most {grown / 1e6:.0f} the engine")


def resident():
    """Bytes of memory in use now."""
    pages = int(Path("/proc/self/statm").read_text(encoding="ascii").split()[1])
    return pages * resource.getpagesize()


def around_giant(count, oversize):
    """Return a scene and its start: grains on a jittered lattice about one oversize particle."""
    radius = 1e-5
    spacing = radius * (4.0 * math.pi / 3.0 / SPARSE) ** (1.0 / 3.0)
    reach = (GIANT + 2.0) * radius
    hole = 4.0 / 3.0 * math.pi * (reach + spacing) ** 3
    cells = math.ceil((count + hole / spacing**3) ** (1.0 / 3.0)) + 1
    half = 0.5 * cells * spacing
    random = np.random.default_rng(1)
    along = (np.arange(cells) + 0.5) * spacing - half
    sites = np.stack(np.meshgrid(along, along, along), axis=-1).reshape(-1, 3)
    jitter = 0.5 * spacing - 2.0 * radius
    sites += random.uniform(-jitter, jitter, sites.shape)
    sites = sites[np.linalg.norm(sites, axis=1) > reach]
    sites = random.permutation(sites)[:count]
    assert len(sites) == count
    scene = make_scene(count + oversize, radius, 1.0, 0.0, half)
    scene = scene._replace(end_time=time_of(scene, SPARSE, 1))
    return scene, grains_and_giant(scene, sites, oversize, random)


def grains_and_giant(scene, sites, oversize, random):
    particles = new_particles(scene, scene.particles)
    count = len(sites)
    particles.position[:, :count] = sites.T
    particles.velocity[:, :count] = SPEED * random.uniform(-1.0, 1.0, (3, count))
    if oversize:
        particles.radius[count] *= GIANT
        particles.mass[count] *= GIANT**3
    return particles


@pytest.mark.benchmark
def test_print_the_cost_of_a_giant():
    warm_up()
    print(f"\ngrains at phi = {SPARSE:g} with and without a sphere {GIANT:g} times their radius")
    widths = (8, 8, 13, 19, 16, 10)
    titles = ("N", "oversize", "collisions", "events/collision", "us/collision", "us/event")
    print_row(widths, titles)
    for count in (2000, 8000, 32_000):
        for oversize in (False, True):
            scene, particles = around_giant(count, oversize)
            seconds, ledger, _ = median_run(scene, particles, 3)
            impacts, events = int(ledger.counts[COLLISIONS]), int(ledger.counts[STEPS])
            row = (count, "yes" if oversize else "no", impacts, f"{events / impacts:.2f}")
            micro = (f"{seconds / impacts * 1e6:.3f}", f"{seconds / events * 1e6:.3f}")
            print_row(widths, row + micro)
