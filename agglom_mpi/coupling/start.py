"""How a box starts: as it was given, and for the rest as a sample of the scene starts."""

from typing import Any

import numpy as np

from agglom_mpi.coupling.given import (
    Floats,
    check_positions,
    check_radii,
    check_temperatures,
    number_of,
    overlapping_pair,
    read,
    read_grains,
)
from agglom_mpi.coupling.state import BoxParticles
from agglom_mpi.physics.scales import HEAVIEST, LIGHTEST
from agglom_mpi.simulation.boundary import Periodic
from agglom_mpi.simulation.initial_state import EqualSizes, Sizes
from agglom_mpi.simulation.scene import Scene
from agglom_mpi.simulation.stepwise import empty_particles, overlaps_of, scatter


def start(
    scene: Scene,
    random: np.random.Generator,
    particles: int | None,
    radii: Any,
    velocities: Any,
    temperatures: Any,
    positions: Any,
    grains: Any,
) -> BoxParticles:
    """Return the particles that a `Box` starts with; its arguments are described there."""
    given = {
        "radii": radii,
        "velocities": velocities,
        "temperatures": temperatures,
        "positions": positions,
    }
    count = number_of(particles, scene.particles, **given)
    numbers = read_grains(grains, count)
    sizes = np.full(count, scene.radius) if radii is None else read("radii", radii, random, count)
    check_radii(sizes, scene.half_width)
    masses = _masses(scene, sizes)
    places = None if positions is None else read("positions", positions, random, count)
    if places is not None:
        check_positions(places, scene.half_width)
        _check_apart(scene, places, sizes)
    drawn = np.empty((3, count)) if velocities is None else None
    if places is None or drawn is not None:
        places = _scatter(scene, random, sizes, places, drawn)
    speeds = drawn.T.copy() if drawn is not None else read("velocities", velocities, random, count)
    if temperatures is None:
        warmth = np.full(count, scene.temperature)
    else:
        warmth = read("temperatures", temperatures, random, count)
        check_temperatures(warmth)
    return BoxParticles(places, speeds, sizes, masses, warmth, numbers, np.arange(count))


def _masses(scene: Scene, radii: Floats) -> Floats:
    masses: Floats = scene.mass * (radii / scene.radius) ** 3
    if not np.all((masses >= LIGHTEST) & (masses <= HEAVIEST)):
        raise ValueError(
            f"radii from {radii.min():g} to {radii.max():g} m make masses from {masses.min():g} to "
            f"{masses.max():g} kg; must be between {LIGHTEST:g} and {HEAVIEST:g} kg"
        )
    return masses


def _scatter(
    scene: Scene,
    random: np.random.Generator,
    radii: Floats,
    positions: Floats | None,
    velocity: Floats | None,
) -> Floats:
    """Place whom nobody has placed, the largest first, and draw `velocity`, shape (3, n), if any.

    Returns the positions in m, shape (n, 3).
    """
    laws, half_width = (scene.escape, scene.velocities), scene.half_width
    if positions is not None:
        scatter(*laws, random, None, half_width, np.empty((3, 0)), velocity)
        return positions
    order = np.argsort(-radii, kind="stable")
    sizes: EqualSizes | Sizes = EqualSizes(2.0 * float(radii[0]))
    if np.any(radii != radii[0]):
        sizes = Sizes(radii[order], float(radii.max()))
    placed = np.empty((3, len(radii)))
    if not scatter(*laws, random, sizes, half_width, placed, velocity):
        fraction = np.sum((radii / half_width) ** 3) * np.pi / 6.0
        raise ValueError(
            f"radii fill {fraction:.3g} of the box with {len(radii)} spheres, and one found no "
            "free place; must be fewer or smaller, or give positions"
        )
    positions = np.empty((len(radii), 3))
    positions[order] = placed.T
    return positions


def _check_apart(scene: Scene, positions: Floats, radii: Floats) -> None:
    """Raise a ValueError if any two spheres overlap."""
    count = len(radii)
    particles = empty_particles(scene, count)
    particles.size[0] = count
    particles.position[:] = positions.T
    particles.radius[:] = radii
    if overlaps_of(scene, particles) > 0:
        side, periodic = 2.0 * scene.half_width, isinstance(scene.escape, Periodic)
        pair = overlapping_pair(positions, radii, side, periodic)
        raise ValueError(f"positions {pair}; must not overlap")
