"""Censuses: how many particles of which size a sample has at set times, in fixed classes.

Measured sizes are compared with all samples of a string together. So a sample leaves no curve, but
counts and masses in classes of the diameter over the mean diameter of the grains, each at most 2 %
wide. A class at either end takes what lies beyond it, too.
"""

import math
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from agglom_mpi.compilation.kernels import kernel
from agglom_mpi.compilation.stages import inlined
from agglom_mpi.measurements.layout import CENSUS_COLUMNS, CLASS_WIDTH, CensusLayout
from agglom_mpi.simulation.measurement import mean_temperature
from agglom_mpi.simulation.trajectory import observe

EXAMPLE_LAYOUT: Final = CensusLayout((math.inf,), 0.0, 1)
"""A layout, for kernels to be compiled for."""


class CensusRoom(NamedTuple):
    """Censuses of n samples, as kernels fill them.

    Attributes
    ----------
    times
        Shape (T,), s.
    lower
        As in the layout, shape (1,).
    counts
        Particles in each class, shape (n, T, B).
    masses
        Their mass in kg, shape (n, T, B).
    largest
        Mass of the largest particle in kg, shape (n, T).
    temperatures
        Mass-weighted mean temperature in K, shape (n, T).
    """

    times: NDArray[np.float64]
    lower: NDArray[np.float64]
    counts: NDArray[np.uint32]
    masses: NDArray[np.float64]
    largest: NDArray[np.float64]
    temperatures: NDArray[np.float64]


def new_census_room(layout: CensusLayout, count: int) -> CensusRoom:
    """Return room for the censuses of `count` samples."""
    shape = count, len(layout.times), layout.classes
    return CensusRoom(
        np.array(layout.times),
        np.array([layout.lower]),
        np.zeros(shape, np.uint32),
        np.zeros(shape),
        np.zeros(shape[:2]),
        np.zeros(shape[:2]),
    )


def census_values(census: CensusRoom) -> dict[str, NDArray[Any]]:
    """Return the values of the columns of n samples, each (n, …), by name."""
    return dict(zip(CENSUS_COLUMNS, census[2:], strict=True))


@kernel
def take_census(scene, particles, engine_state, observer, initial, census, k, t):
    """Take the census of sample k at time t of `census`, up to which its run has come.

    It is taken of copies, so that nothing else changes.

    Parameters
    ----------
    scene : Scene
    particles : Particles, unchanged
    engine_state : the state of the scene's engine
    observer : Observer
    initial : array of `INITIAL`, shape (1,)
    census : CensusRoom, filled
    k, t : int
    """
    time = census.times[t]
    for axis in range(3):
        observer.drift[axis] = initial[0]["drift"][axis]
    observe(scene, particles, engine_state, observer, time)
    count_classes(scene, observer.copy, census, k, t)


@inlined
def count_last(scene, particles, census, k):
    """Take the censuses at the end of sample k and later of its final particles."""
    for t in range(len(census.times)):
        if census.times[t] >= scene.end_time:
            count_classes(scene, particles, census, k, t)


@inlined
def count_classes(scene, particles, census, k, t):
    """Sort particles without gaps into the classes of census t of sample k."""
    counts, masses = census.counts[k, t], census.masses[k, t]
    for b in range(len(counts)):
        counts[b] = 0
        masses[b] = 0.0
    last, largest = len(counts) - 1, 0.0
    for i in range(particles.size[0]):
        particle = particles.records[i]
        place = (math.log(particle["radius"] / scene.radius) - census.lower[0]) / CLASS_WIDTH
        b = min(last, max(0, int(place)))
        counts[b] += 1
        masses[b] += particle["mass"]
        largest = max(largest, particle["mass"])
    census.largest[k, t] = largest
    census.temperatures[k, t] = mean_temperature(scene, particles)
