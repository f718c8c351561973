"""Frames: the particles of a sample at set times, as arrays, and the choice of the times."""

from collections.abc import Sequence
from typing import NamedTuple, TypeVar

import numpy as np
import numpy.typing as npt

from agglom_mpi.outcome import FinalParticles

Floats = npt.NDArray[np.float64]


Integers = npt.NDArray[np.int64]


class Frames(NamedTuple):
    """The particles of one sample at F times; at most N, the number of grains.

    Of frame f the first n = `particles[f]` entries are filled, in the order of the final state; the
    others hold nan, 0 grains and the label −1. Positions are in the box, −D ≤ r ≤ D, also in a
    periodic one, where who leaves comes back on the other side. Velocities are in the frame of
    reference of the box.

    Attributes
    ----------
    times
        Shape (F,), s, ascending.
    particles
        Particles present, shape (F,).
    labels
        Identities, shape (F, N). Grains are numbered 0 … N−1 as they are placed; an aggregate keeps
        the label of one of the two that bonded; of the pieces of a broken one, one keeps its label
        and the others get new numbers.
    positions, velocities
        Shape (F, N, 3), m and m/s.
    radii, masses, temperatures
        Shape (F, N), m, kg and K; the temperature of the scene where nothing changes it, nan
        where the scene has none.
    grains
        Original grains in each particle, shape (F, N).
    spins
        Angular velocities, shape (F, N, 3), rad/s; None where grains do not spin.
    """

    times: Floats
    particles: Integers
    labels: Integers
    positions: Floats
    velocities: Floats
    radii: Floats
    masses: Floats
    temperatures: Floats
    grains: Integers
    spins: Floats | None = None

    @property
    def has_temperature(self) -> bool:
        """Whether any particle has a temperature."""
        return bool(np.isfinite(self.temperatures).any())


P = TypeVar("P", FinalParticles, Frames)


def without_temperatures(particles: P) -> P:
    """Return particles with nan for the 0 K that kernels keep where a scene has no temperature."""
    kept = particles.temperatures
    return particles._replace(temperatures=np.where(kept == 0.0, np.nan, kept))


def new_frames(times: Floats, grains: int, spins: bool = False) -> Frames:
    """Return empty frames at `times` in s, shape (F,), of a scene of `grains` grains.

    With `spins`, also of their angular velocities.
    """
    count = len(times)
    return Frames(
        times=times,
        particles=np.zeros(count, np.int64),
        labels=np.full((count, grains), -1, np.int64),
        positions=np.full((count, grains, 3), np.nan),
        velocities=np.full((count, grains, 3), np.nan),
        radii=np.full((count, grains), np.nan),
        masses=np.full((count, grains), np.nan),
        temperatures=np.full((count, grains), np.nan),
        grains=np.zeros((count, grains), np.int64),
        spins=np.full((count, grains, 3), np.nan) if spins else None,
    )


def frame_times(frames: int | Sequence[float] | Floats, end_time: float) -> Floats:
    """Return the times of frames in s, shape (F,), of a run to `end_time` in s.

    Parameters
    ----------
    frames
        How many, evenly spaced from 0 to the end, both included (a single one is at 0); or the
        times themselves in s, ascending.

    Raises
    ------
    ValueError
        If this gives no times from 0 to the end that ascend; says why.
    """
    if isinstance(frames, int | np.integer) and not isinstance(frames, bool):
        if frames < 1:
            raise ValueError(f"are {frames}; must be at least 1")
        return np.linspace(0.0, end_time, int(frames))
    try:
        times = np.array(frames, dtype=np.float64)
    except (TypeError, ValueError):
        times = np.empty(())
    if isinstance(frames, str | bool) or times.ndim != 1 or times.size == 0:
        raise ValueError(f"are {frames!r}; must be how many, or a sequence of times in s")
    outside = times[~((times >= 0.0) & (times <= end_time))]
    if outside.size:
        raise ValueError(f"have one at {outside[0]:g} s; must be from 0 to {end_time:g} s")
    early = np.flatnonzero(np.diff(times) <= 0.0)
    if early.size:
        first, second = times[early[0] : early[0] + 2]
        raise ValueError(f"have one at {second:g} s after one at {first:g} s; must ascend")
    return times
