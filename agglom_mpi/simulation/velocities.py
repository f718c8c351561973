"""How fast do the grains start?"""

from typing import NamedTuple

import numpy as np

from agglom_mpi.compilation import Submodel, question


class UniformX(NamedTuple):
    """v_x = v⁰ r with r ~ U[0, 1), v_y = v_z = 0, m/s  [A 28]."""

    speed: float


class SpreadVelocities(NamedTuple):
    """Mean plus v⁰λ in x and `transverse`·v⁰λ in y and z, λ ~ U[−1, 1) each, m/s  [B 7.3]."""

    speed: float
    mean: tuple[float, float, float]
    transverse: float


@question
def draw_velocities(law: Submodel, random: np.random.Generator, velocity: np.ndarray) -> None:
    """Fill `velocity`, shape (3, N), m/s."""


@draw_velocities.answer(UniformX)
def _uniform_x(law, random, velocity):  # type: ignore[no-untyped-def]
    for i in range(velocity.shape[1]):
        velocity[0, i] = law.speed * random.random()
        velocity[1, i] = 0.0
        velocity[2, i] = 0.0


@draw_velocities.answer(SpreadVelocities)
def _spread(law, random, velocity):  # type: ignore[no-untyped-def]
    for i in range(velocity.shape[1]):
        for axis in range(3):
            scale = law.speed if axis == 0 else law.speed * law.transverse
            velocity[axis, i] = law.mean[axis] + scale * (2.0 * random.random() - 1.0)
