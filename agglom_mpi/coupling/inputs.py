"""Inputs of a box: numbers, arrays or distributions, checked one by one, and its first state."""

from typing import Any, Final

import numpy as np
import numpy.typing as npt

from agglom_mpi.config.arguments import read_count
from agglom_mpi.coupling.state import BoxParticles
from agglom_mpi.formatting import pluralise
from agglom_mpi.physics.scales import HEAVIEST, LIGHTEST
from agglom_mpi.physics.size_distributions import draw_radii
from agglom_mpi.simulation.boundary import is_periodic
from agglom_mpi.simulation.initial_state import DifferentSizes, EqualSizes, scatter
from agglom_mpi.simulation.scene import Scene
from agglom_mpi.simulation.stepwise import overlaps_of, room_for_particles

Floats = npt.NDArray[np.float64]

VECTORS: Final = ("positions", "velocities")
"""Arguments with three components per particle."""
DEFINING: Final = ("radii", "positions", "velocities")
"""Arguments whose arrays say how many particles there are."""
UNITS: Final = {"radii": "m", "positions": "m", "velocities": "m/s", "temperatures": "K"}


def initial_particles(
    scene: Scene,
    random: np.random.Generator,
    particles: int | None,
    radii: Any,
    velocities: Any,
    temperatures: Any,
    positions: Any,
    grains: Any,
) -> BoxParticles:
    """Return the particles that a `Box` starts with; what is not given is as in a sample.

    Parameters
    ----------
    scene
        The scene of the campaign.
    random
        Stream of the sample; draws positions, velocities and what distributions give.
    particles, radii, velocities, temperatures, positions, grains
        As for `Box`.

    Raises
    ------
    ValueError
        If an input is not possible in the scene; names it, its value and what is allowed.
    """
    count = count_particles(
        particles,
        scene.particles,
        radii=radii,
        velocities=velocities,
        temperatures=temperatures,
        positions=positions,
    )
    grain_counts = read_grains(grains, count)
    if radii is None:
        radii = scene.radius * draw_radii(scene.sizes, random, count)
    else:
        radii = read_values("radii", radii, random, count)
    limit = f"greater than 0 m and less than half_width, {scene.half_width:g} m"
    raise_if("radii", radii, ~((radii > 0.0) & (radii < scene.half_width)), limit)
    masses = _masses(scene, radii)
    if positions is not None:
        positions = read_values("positions", positions, random, count)
        limit = f"from {-scene.half_width:g} to {scene.half_width:g} m"
        raise_if("positions", positions, np.abs(positions) > scene.half_width, limit)
        _check_apart(scene, positions, radii)
    # Drawn in the order of a sample: positions, then velocities.
    drawn = np.empty((3, count)) if velocities is None else None
    if positions is None or drawn is not None:
        positions = _place_and_draw(scene, random, radii, positions, drawn)
    if drawn is not None:
        velocities = drawn.T.copy()
    else:
        velocities = read_values("velocities", velocities, random, count)
    if temperatures is None:
        temperatures = np.full(count, scene.temperature)
    else:
        temperatures = read_values("temperatures", temperatures, random, count)
    labels = np.arange(count)
    return BoxParticles(positions, velocities, radii, masses, temperatures, grain_counts, labels)


def count_particles(particles: int | None, default: int, **inputs: Any) -> int:
    """Return the number of particles of a box, on which all its inputs must agree.

    The argument `particles` says it, or an array of `DEFINING`; else it is that of the scene, so
    that a list of three temperatures does not make a box of three grains.

    Parameters
    ----------
    particles
        The argument `particles`, if given.
    default
        The number of the scene.
    inputs
        The other inputs by name, None for those not given.

    Raises
    ------
    ValueError
        If two inputs are for different numbers, or one is for none.
    """
    counts: dict[str, int] = {}
    if particles is not None:
        try:
            counts["particles"] = read_count(particles, least=1)
        except ValueError as error:
            raise ValueError(f"particles {error}") from None
    for name, values in inputs.items():
        if not (values is None or hasattr(values, "rvs") or callable(values)):
            shape = _numbers(name, values).shape
            if len(shape) == (2 if name in VECTORS else 1):
                counts[name] = shape[0]
    said = [name for name in ("particles", *DEFINING) if name in counts]
    first, count = (said[0], counts[said[0]]) if said else ("the scene", default)
    for name, other in counts.items():
        if other != count:
            is_for, hint = ("for", "") if said else ("is for", f", or give particles={other}")
            raise ValueError(
                f"{name} are for {pluralise(other, 'particle')}, but {first} {is_for} {count}; "
                f"must be for as many{hint}"
            )
    if count < 1:
        raise ValueError(f"{first} are for no particle; must be for at least 1")
    return count


def read_values(name: str, value: Any, random: np.random.Generator, count: int) -> Floats:
    """Return the values of one argument, shape (count,), or (count, 3) for a vector.

    Parameters
    ----------
    name
        The argument, one of `UNITS`.
    value
        One value for all, an array, a frozen distribution, whose `rvs(size=..., random_state=...)`
        draws every component, or a function of (random, count).

    Raises
    ------
    ValueError
        If these are not `count` finite numbers or vectors, or a temperature is below zero.
    """
    shape = (count, 3) if name in VECTORS else (count,)
    if hasattr(value, "rvs"):
        values = _numbers(name, value.rvs(size=shape, random_state=random))
    elif callable(value):
        values = _numbers(name, value(random, count))
    else:
        values = _numbers(name, value)
    if values.shape not in (shape, shape[1:]):
        one = "3 numbers" if name in VECTORS else "one number"
        raise ValueError(f"{name} have the shape {values.shape}; must be {shape}, or {one} for all")
    values = np.array(np.broadcast_to(values, shape))
    raise_if(name, values, ~np.isfinite(values), "finite")
    if name == "temperatures":
        raise_if(name, values, values < 0.0, "at least 0 K")
    return values


def raise_if(name: str, values: Floats, wrong: npt.NDArray[np.bool_], allowed: str) -> None:
    """Raise a ValueError with the first of the `wrong` values and what is `allowed`, if any is."""
    if wrong.any():
        index = tuple(int(i) for i in np.argwhere(wrong)[0])
        inside = ", ".join(map(str, index))
        raise ValueError(f"{name}[{inside}] is {values[index]:g} {UNITS[name]}; must be {allowed}")


def read_grains(value: Any, count: int) -> npt.NDArray[np.int64]:
    """Return the number of grains in each of `count` particles; one in each if `value` is None."""
    if value is None:
        return np.ones(count, np.int64)
    grains = np.asarray(value)
    if grains.shape != (count,) or grains.dtype.kind not in "iu" or np.any(grains < 1):
        raise ValueError(
            f"grains are {value!r}; must be {count} whole numbers of at least 1, one per particle"
        )
    return grains.astype(np.int64)


def overlapping_pair(positions: Floats, radii: Floats, side: float, periodic: bool) -> str:
    """Return words on the first two spheres that overlap: which, and by how much."""
    for i in range(len(radii) - 1):
        away = positions[i + 1 :] - positions[i]
        if periodic:
            away -= side * np.rint(away / side)
        depth = radii[i] + radii[i + 1 :] - np.sqrt(np.sum(away**2, axis=1))
        j = int(np.argmax(depth))
        if depth[j] > 1e-12 * (radii[i] + radii[i + 1 + j]):
            return f"{i} and {i + 1 + j} overlap by {depth[j]:.3g} m"
    return "overlap"


def _numbers(name: str, values: Any) -> Floats:
    try:
        return np.asarray(values, dtype=np.float64)
    except (TypeError, ValueError):
        raise ValueError(
            f"{name} are {values!r}; must be numbers in {UNITS[name]}, a distribution with rvs, or "
            "a function of (random, count)"
        ) from None


def _masses(scene: Scene, radii: Floats) -> Floats:
    masses: Floats = scene.mass * (radii / scene.radius) ** 3
    if not np.all((masses >= LIGHTEST) & (masses <= HEAVIEST)):
        raise ValueError(
            f"radii from {radii.min():g} to {radii.max():g} m make masses from {masses.min():g} to "
            f"{masses.max():g} kg; must be between {LIGHTEST:g} and {HEAVIEST:g} kg"
        )
    return masses


def _place_and_draw(
    scene: Scene,
    random: np.random.Generator,
    radii: Floats,
    positions: Floats | None,
    velocity: Floats | None,
) -> Floats:
    """Place spheres that have no positions, and fill `velocity`, shape (3, n), if it is not None.

    The largest are placed first, which jams less. Returns the positions in m, shape (n, 3).
    """
    laws, half_width = (scene.escape, scene.velocities), scene.half_width
    never = np.zeros(1, np.uint8)
    if positions is not None:
        scatter(*laws, random, None, half_width, np.empty((3, 0)), velocity, never)
        return positions
    order = np.argsort(-radii, kind="stable")
    sizes: EqualSizes | DifferentSizes = EqualSizes(2.0 * float(radii[0]))
    if np.any(radii != radii[0]):
        sizes = DifferentSizes(radii[order], float(radii.max()))
    placed = np.empty((3, len(radii)))
    if not scatter(*laws, random, sizes, half_width, placed, velocity, never):
        fraction = np.sum((radii / half_width) ** 3) * np.pi / 6.0
        raise ValueError(
            f"radii fill {fraction:.3g} of the box with {len(radii)} spheres, and one found no "
            "free place; must be fewer or smaller, or give positions"
        )
    positions = np.empty((len(radii), 3))
    positions[order] = placed.T
    return positions


def _check_apart(scene: Scene, positions: Floats, radii: Floats) -> None:
    count = len(radii)
    particles = room_for_particles(scene, count)
    particles.size[0] = count
    particles.position[:] = positions.T
    particles.radius[:] = radii
    if overlaps_of(scene, particles) > 0:
        side, periodic = 2.0 * scene.half_width, is_periodic(scene.escape)
        pair = overlapping_pair(positions, radii, side, periodic)
        raise ValueError(f"positions {pair}; must not overlap")
