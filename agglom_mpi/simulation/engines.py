"""Engines that a scene can name, and their numbers; each engine registers how it runs."""

from collections.abc import Iterator
from typing import Annotated, ClassVar, Literal, Self

from agglom_mpi.declaration.components import In, Whole
from agglom_mpi.declaration.declared import FieldPath
from agglom_mpi.declaration.laws import Law


class Engine(Law):
    """How particles are carried from the start of a sample to its end.

    Attributes
    ----------
    has_time_steps
        Whether it advances in time steps, as laws that are integrated by steps need.
    uses_linked_cells
        Whether it looks for partners by the linked cells of `event_driven.cells`.
    """

    found_in = ""
    may_be_own = False
    has_time_steps: ClassVar[bool] = True
    uses_linked_cells: ClassVar[bool] = False

    def is_frame_dependent(self) -> bool:
        """Return True: time steps shift overlapping spheres along their velocities [A 8]."""
        return True

    def with_steps(self, steps: int) -> Self | None:
        """Return the engine with another number of steps; None if it has none to choose."""
        return None

    @property
    def shortest_step(self) -> float | None:
        """Shortest time step in s where steps differ; None where they are equal, or absent."""
        return None


class EventDriven(Engine):
    """Collisions at exact times, without time steps.

    Inelastic spheres can collide infinitely often in finite time: a sample that needs more than
    `budget` events per grain fails instead of running for ever. Cell crossings are events, too: in
    a dilute gas of 1000 grains some 14 per grain and box length.

    Attributes
    ----------
    budget
        Most events of a sample, for each grain; a sample that needs more fails.
    """

    law: Literal["event"] = "event"
    budget: Annotated[int, Whole(at_least=1, at_most=10**9)] = 20_000
    has_time_steps = False
    uses_linked_cells = True

    @property
    def summary(self) -> str:
        """One line on the engine."""
        return f"event-driven, exact times, at most {self.budget:,} events per grain"

    def is_frame_dependent(self) -> bool:
        """Return False: flights are exact in every frame."""
        return False


class FixedSteps(Engine):
    """Equal time steps over the run  [A].

    Attributes
    ----------
    steps
        Number of time steps of a sample.
    """

    law: Literal["fixed"] = "fixed"
    steps: Annotated[int, Whole(at_least=1)] = 200

    @property
    def summary(self) -> str:
        """One line on the engine."""
        return f"{self.steps} equal steps [A]"

    def with_steps(self, steps: int) -> Self | None:
        """Return the engine with another number of steps."""
        return type(self)(steps=steps)


class AdaptiveSteps(Engine):
    """Steps to the next contact of nearest neighbours, from `floor` to `ceiling` in s  [B 6.14].

    Attributes
    ----------
    floor
        Shortest step.
    ceiling
        Longest step.
    """

    law: Literal["adaptive"] = "adaptive"
    floor: Annotated[float, In("s", above=0)] = 1e-6
    ceiling: Annotated[float, In("s", above=0)] = 1e-3

    @property
    def shortest_step(self) -> float:
        """The `floor`."""
        return self.floor

    @property
    def summary(self) -> str:
        """One line on the engine."""
        return f"adaptive steps, {self.floor:g} to {self.ceiling:g} s [B 6.14]"

    def problems(self) -> Iterator[tuple[FieldPath, str]]:
        """Yield a floor above the ceiling."""
        if self.floor > self.ceiling:
            message = f"is {self.floor:g} s; must be at most ceiling, which is {self.ceiling:g} s"
            yield ("floor",), message
