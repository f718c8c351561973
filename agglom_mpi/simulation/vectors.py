"""Vectors of three components in kernels, and those between two particles."""

from agglom_mpi.compilation.stages import inlined
from agglom_mpi.simulation.boundary import separation


@inlined
def dot(a, b):
    """Scalar product of two vectors."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@inlined
def cross(a, b):
    """Vector product."""
    x = a[1] * b[2] - a[2] * b[1]
    y = a[2] * b[0] - a[0] * b[2]
    return x, y, a[0] * b[1] - a[1] * b[0]


@inlined
def scaled(a, factor):
    """Vector times a number."""
    return a[0] * factor, a[1] * factor, a[2] * factor


@inlined
def sum_of(a, factor, b):
    """Vector a + `factor` b."""
    return a[0] + factor * b[0], a[1] + factor * b[1], a[2] + factor * b[2]


@inlined
def separation_vector(escape, one, other, half_width):
    """Vector in m from one particle to another, across faces where the box is periodic."""
    return (
        separation(escape, other["x"] - one["x"], half_width),
        separation(escape, other["y"] - one["y"], half_width),
        separation(escape, other["z"] - one["z"], half_width),
    )


@inlined
def relative_velocity(one, other):
    """Velocity in m/s of one particle relative to another."""
    return one["u"] - other["u"], one["v"] - other["v"], one["w"] - other["w"]
