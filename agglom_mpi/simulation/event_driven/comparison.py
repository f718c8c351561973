"""Comparison of one particle with many at a time: which of them it may collide with, and how soon.

Their trajectories lie side by side: those of the oversize particles always, behind them copies of
those in the cells around. The loop over them has neither branches nor gaps, so that a compiler
makes vector instructions of it.
"""

from typing import Final

import numpy as np

from agglom_mpi.compilation.kernels import fused
from agglom_mpi.compilation.stages import inlined
from agglom_mpi.simulation.boundary import flow_speed, image_offset, is_sheared, nearest_image
from agglom_mpi.simulation.event_driven.cells import OVERSIZE, copy_flight
from agglom_mpi.simulation.shear import plus_images

VECTOR_LENGTH: Final = 8
"""Particles that are compared at once; their number is rounded up to a multiple."""

SLACK: Final = 1e-9
"""Share of b² by which b² − ac may be negative by rounding where c is not far above b²/a."""

IMAGE_MARGIN: Final = 1.0 + 1e-9
"""Share of D at which the nearest image is another one for certain, so that prediction finds it."""

LARGEST: Final = float(np.finfo(np.float64).max)
"""Less than the time of what does not collide."""

SOONEST: Final = 0
IMAGE_RATE: Final = 1
"""Rows of `Cells.comparison`."""


@inlined
def gather_flights(cells, flights, count):
    """Copy the trajectories of `count` candidates behind those of the oversize particles.

    Returns the number of both together.
    """
    others = cells.shape[OVERSIZE]
    for k in range(count):
        copy_flight(cells, others + k, flights.trajectory[cells.candidates[k]])
    return others + count


@inlined
def scalar_product(x, y, z, u, v, w):
    """Scalar product of two vectors."""
    return fused(x, u, fused(y, v, z * w))


@inlined
def way_after(scene, coordinate, velocity, flight, origin, side, per_side):
    """Way in m along an axis from `origin` to the nearest image of a particle after a flight in s.

    `side` is D in m, and `per_side` its inverse.
    """
    way = fused(velocity, flight, coordinate) - origin
    return nearest_image(scene.escape, way, side, per_side)


@inlined
def images_above(scene, coordinate, velocity, flight, origin, per_side):
    """Images of a sheared box from `origin` in m up to where y leads in a flight in s; else 0."""
    if not is_sheared(scene.escape):
        return 0.0
    return np.rint((fused(velocity, flight, coordinate) - origin) * per_side)


@inlined
def compare(scene, cells, count, trajectory, x, y, z, now, safe):
    """Compare a particle at (x, y, z) in m with the first `count` beside one another.

    Into `Cells.comparison` goes for each of them the time from `now` in s before which they do not
    collide, inf if they do not; and, unless `safe` is None, the inverse of the time in 1/s after
    which another image of it may touch, 0 if the sum of the radii is at most `safe` in m.

    A collision is not before the time e/(2c) for e = |dr|² − reach² and the approach c = −dr·dv.
    """
    block, soonest, rate = cells.flights, cells.comparison[SOONEST], cells.comparison[IMAGE_RATE]
    side, per_side = 2.0 * scene.half_width, 0.5 / scene.half_width
    u, v, w, radius = trajectory["u"], trajectory["v"], trajectory["w"], trajectory["radius"]
    ahead, faster = image_offset(scene.escape, side, now), flow_speed(scene.escape, side)
    for k in range((count + VECTOR_LENGTH - 1) // VECTOR_LENGTH * VECTOR_LENGTH):
        flight = now - block[6, k]
        images = images_above(scene, block[1, k], block[4, k], flight, y, per_side)
        origin = plus_images(scene.escape, x, images, ahead)
        dx = way_after(scene, block[0, k], block[3, k], flight, origin, side, per_side)
        dy = way_after(scene, block[1, k], block[4, k], flight, y, side, per_side)
        dz = way_after(scene, block[2, k], block[5, k], flight, z, side, per_side)
        du = plus_images(scene.escape, block[3, k] - u, images, -faster)
        dv, dw = block[4, k] - v, block[5, k] - w
        closing = scalar_product(dx, dy, dz, du, dv, dw)
        reach = radius + block[7, k]
        excess = fused(-reach, reach, scalar_product(dx, dy, dz, dx, dy, dz))
        square = scalar_product(du, dv, dw, du, dv, dw)
        likely = fused(-square, excess, (1.0 + SLACK) * closing * closing)
        time = (1.0 - SLACK) * excess / (-2.0 * closing)
        soonest[k] = time if (closing < 0.0) & (likely > 0.0) else np.inf
        if safe is not None:
            end = max(side - reach, scene.half_width * IMAGE_MARGIN)
            speed, way = abs(du), way_to_image(end, dx, du)
            speed, way = sooner(speed, way, abs(dv), way_to_image(end, dy, dv))
            speed, way = sooner(speed, way, abs(dw), way_to_image(end, dz, dw))
            rate[k] = speed / way if reach > safe else 0.0


@inlined
def way_to_image(end, difference, velocity):
    """Way in m until a difference that is within ±`end` is there, at this velocity in m/s."""
    return end - (difference if velocity > 0.0 else -difference)


@inlined
def sooner(speed, way, other_speed, other_way):
    """Return the speed and way that take less time, without dividing."""
    earlier = other_speed * way > speed * other_way
    return other_speed if earlier else speed, other_way if earlier else way


@inlined
def highest_rate(cells, count):
    """Return the largest of the first `count` rates of images in 1/s; four at a time."""
    rate = cells.comparison[IMAGE_RATE]
    a, b, c, d = 0.0, 0.0, 0.0, 0.0
    for k in range(0, count - 3, 4):
        a, b = max(a, rate[k]), max(b, rate[k + 1])
        c, d = max(c, rate[k + 2]), max(d, rate[k + 3])
    for k in range(count // 4 * 4, count):
        a = max(a, rate[k])
    return max(max(a, b), max(c, d))


@inlined
def keep_likely(cells, count, limit):
    """Reduce the candidates to those of the first `count` that may collide within `limit` in s.

    The oversize ones, which come first side by side, go behind the others. Their times before which
    they do not collide come with them. Returns how many are left.
    """
    soonest, others, left = cells.comparison[SOONEST], cells.shape[OVERSIZE], 0
    limit = min(limit, LARGEST)
    for k in range(others, count):
        cells.candidates[left] = cells.candidates[k - others]
        cells.likely_times[left] = soonest[k]
        left += 1 if soonest[k] <= limit else 0
    for first in range(0, others, VECTOR_LENGTH):
        if is_any_likely(soonest, first, limit):
            for k in range(first, min(first + VECTOR_LENGTH, others)):
                cells.candidates[left] = cells.oversize[k]
                cells.likely_times[left] = soonest[k]
                left += 1 if soonest[k] <= limit else 0
    return left


@inlined
def is_any_likely(soonest, first, limit):
    """Whether one of the `VECTOR_LENGTH` times from `first` on is at most `limit`."""
    a = (soonest[first] <= limit) | (soonest[first + 1] <= limit)
    b = (soonest[first + 2] <= limit) | (soonest[first + 3] <= limit)
    c = (soonest[first + 4] <= limit) | (soonest[first + 5] <= limit)
    d = (soonest[first + 6] <= limit) | (soonest[first + 7] <= limit)
    return a | b | c | d
