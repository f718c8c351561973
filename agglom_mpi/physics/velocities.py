"""Laws of the starting velocities."""

import math
from typing import Annotated, ClassVar, Literal

import numpy as np

from agglom_mpi.compilation.stages import formula
from agglom_mpi.declaration.components import In
from agglom_mpi.declaration.laws import Law
from agglom_mpi.declaration.needed import needed


class Velocities(Law):
    """Law of the starting velocities, of scale v⁰, the variable `relative_speed` in m/s."""

    variables = ("relative_speed",)

    @needed
    def draw_velocities(self, random: np.random.Generator, velocity: np.ndarray) -> None:
        """Fill `velocity`, shape (3, N), m/s, with random starting velocities."""
        raise NotImplementedError

    @needed
    def variance(self, speed: float) -> float:
        """Return ⟨|v − ⟨v⟩|²⟩ in m²/s² for v⁰ = `speed` in m/s."""
        raise NotImplementedError

    @needed
    def fastest_approach(self, speed: float) -> float:
        """Return the highest approach speed of two grains at the start, m/s."""
        raise NotImplementedError

    def transverse_speed(self, speed: float) -> float:
        """Return the highest speed in y and z about the mean flow, m/s."""
        return 0.0

    @property
    def mean_flow(self) -> float:
        """Speed that all grains have in common and that does not scale with v⁰, m/s."""
        return 0.0


class UniformX(Velocities):
    """v_x = v⁰ r with r ~ U[0, 1), v_y = v_z = 0  [A 28]."""

    law: Literal["uniform_x"] = "uniform_x"
    summary: ClassVar[str] = "x alone, uniform from 0 to v0 [A]"

    def draw_velocities(self, random, velocity):
        """Draw v_x for each grain."""
        for i in range(velocity.shape[1]):
            velocity[0, i] = self.relative_speed * random.random()
            velocity[1, i] = 0.0
            velocity[2, i] = 0.0

    def variance(self, speed: float) -> float:
        """Return v⁰²/12, of a uniform distribution over the width v⁰."""
        return speed**2 / 12.0

    def fastest_approach(self, speed: float) -> float:
        """Return v⁰: speeds are from 0 to v⁰."""
        return speed


class SpreadVelocities(Velocities):
    """Mean plus v⁰λ in x and `transverse`·v⁰λ in y and z, λ ~ U[−1, 1) each  [B 7.3].

    Attributes
    ----------
    mean
        Mean velocity of all grains, in x, y and z.
    transverse
        Spread in y and z relative to that in x, which is v⁰.
    """

    law: Literal["spread"] = "spread"
    mean: Annotated[tuple[float, float, float], In("m/s")] = (10.0, 10.0, 100.0)
    transverse: Annotated[float, In("1", at_least=0)] = 0.1
    summary: ClassVar[str] = "a mean plus a uniform spread in x, y, z [B]"

    def draw_velocities(self, random, velocity):
        """Draw x, y and z of each grain in turn."""
        for i in range(velocity.shape[1]):
            for axis in range(3):
                scale = self.relative_speed if axis == 0 else self.relative_speed * self.transverse
                velocity[axis, i] = self.mean[axis] + scale * (2.0 * random.random() - 1.0)

    def variance(self, speed: float) -> float:
        """Return (2v⁰)²(1 + 2t²)/12, t the `transverse` spread: L²/12 of a uniform width L."""
        width = 2.0 * speed
        return width**2 * (1.0 + 2.0 * self.transverse**2) / 12.0

    def fastest_approach(self, speed: float) -> float:
        """Return 2v⁰√(1 + 2t²), t the `transverse` spread; the mean does not matter."""
        return 2.0 * speed * math.sqrt(1.0 + 2.0 * self.transverse**2)

    def transverse_speed(self, speed: float) -> float:
        """Return t v⁰."""
        return speed * self.transverse

    @property
    def mean_flow(self) -> float:
        """Magnitude of the mean velocity, m/s."""
        return math.hypot(*self.mean)


draw_velocities = formula(Velocities, Velocities.draw_velocities)
