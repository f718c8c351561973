"""A finished sample as a user's own objective function receives it."""

import math
from collections.abc import Mapping
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from agglom_mpi.outcome import FinalParticles

if TYPE_CHECKING:
    from agglom_mpi.simulation.scene import Scene


class Sample(NamedTuple):
    """Argument of a user's function `module:function`; its arrays are read-only.

    Attributes
    ----------
    parameters : mapping of str to float
        Variables that the scene uses, by name in SI units.
    particles : int
        Particles left, n.
    mean_radius_ratio : float
        Mean of b/b⁰ over them.
    moments : array, shape (4,)
        Mean and central moments 2, 3, 4 of b/b⁰.
    radii : array, shape (n,)
        Final b/b⁰.
    initial_radii : array, shape (N,)
        b/b⁰ of the grains that the sample began with, the largest first; 1 where all are equal.
    temperatures : array, shape (n,), K; 0 where the scene has none
    grains : array of int64, shape (n,)
        Original grains in each particle.
    end_time : float
        Simulated time, s.
    collisions, merges, breakups : int
    spins : array, shape (n, 3), rad/s, or None where grains do not spin
    granular_temperature, rotational_temperature : float
        Of motion and of rotation, m²/s²; nan where grains do not spin.
    """

    parameters: Mapping[str, float]
    particles: int
    mean_radius_ratio: float
    moments: NDArray[np.float64]
    radii: NDArray[np.float64]
    temperatures: NDArray[np.float64]
    grains: NDArray[np.int64]
    end_time: float
    collisions: int
    merges: int
    breakups: int
    initial_radii: NDArray[np.float64]
    spins: NDArray[np.float64] | None = None
    granular_temperature: float = math.nan
    rotational_temperature: float = math.nan


def finished_sample(
    scene: "Scene",
    parameters: Mapping[str, float],
    record: Any,
    final: FinalParticles,
    initial: NDArray[np.float64],
) -> Sample:
    """Return what a user's function receives of a completed sample.

    Parameters
    ----------
    scene
        The scene that was simulated; radii are relative to its grain radius.
    parameters
        The variables that the scene uses, by name in SI units.
    record
        Its `OUTCOME`.
    final
        Its particles.
    initial
        Radii of its grains at the start, relative to the grain radius, shape (N,).
    """
    moments = [record["mean_radius_ratio"], *(record[f"radius_moment_{r}"] for r in (2, 3, 4))]
    return Sample(
        parameters=MappingProxyType(dict(parameters)),
        particles=int(record["particles"]),
        mean_radius_ratio=float(record["mean_radius_ratio"]),
        moments=_read_only(np.array(moments, float)),
        radii=_read_only(final.radii / scene.radius),
        temperatures=_read_only(final.temperatures),
        grains=_read_only(final.grains),
        end_time=float(record["end_time"]),
        collisions=int(record["collisions"]),
        merges=int(record["merges"]),
        breakups=int(record["breakups"]),
        initial_radii=_read_only(initial),
        spins=None if final.spins is None else _read_only(final.spins),
        **{name: float(record[name]) for name in Sample._fields[-2:] if final.spins is not None},
    )


def _read_only(array: NDArray[Any]) -> NDArray[Any]:
    view = array.view()
    view.flags.writeable = False
    return view
