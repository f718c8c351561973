"""Censuses show the particles of a sample at set times, and change nothing of the sample."""

import math

import numpy as np
import pytest
from scenes import SMALL_SCENES

from agglom_mpi.measurements.layout import CLASS_WIDTH, CensusLayout
from agglom_mpi.outcome import COMPLETED
from agglom_mpi.random_streams import generator, key_words
from agglom_mpi.simulation.census import census_values, new_census_room
from agglom_mpi.simulation.frames import new_frames
from agglom_mpi.simulation.sample import simulate_counted, simulate_samples, simulate_scene
from agglom_mpi.simulation.sample_range import new_results, new_watch

pytestmark = pytest.mark.plain

KEY = (7, 1, 2, 3)
TIMES = (3.3e-4, 7.1e-4, math.inf)
LAYOUT = CensusLayout.between(TIMES, 0.2, 5.0)


def counted(scene, number):
    """Record of a sample, its final particles, and its censuses by column."""
    room = new_census_room(LAYOUT, 1)
    record, particles = simulate_counted(scene, generator(*KEY, number), room)
    return record, particles, {name: each[0] for name, each in census_values(room).items()}


@pytest.mark.parametrize("name", SMALL_SCENES)
def test_censuses_change_no_bit_of_a_sample(name):
    for number in range(4):
        record, particles, _ = counted(SMALL_SCENES[name], number)
        other, same = simulate_scene(SMALL_SCENES[name], generator(*KEY, number))
        assert record.tobytes() == other.tobytes()
        left = int(same.size[0])
        assert particles.records[:left].tobytes() == same.records[:left].tobytes()


@pytest.mark.parametrize("name", SMALL_SCENES)
def test_a_census_has_the_particles_of_a_frame_at_its_time(name):
    scene = SMALL_SCENES[name]
    for number in range(4):
        _, _, census = counted(scene, number)
        frames = new_frames(np.array([*TIMES[:-1], scene.end_time]), scene.particles)
        simulate_scene(scene, generator(*KEY, number), frames=frames)
        for t, left in enumerate(frames.particles.tolist()):
            radii, masses = frames.radii[t, :left], frames.masses[t, :left]
            ratio = np.log(radii / scene.radius)
            places = np.floor((ratio - LAYOUT.lower) / CLASS_WIDTH).astype(int)
            places = np.clip(places, 0, LAYOUT.classes - 1)
            expected = np.bincount(places, minlength=LAYOUT.classes)
            assert census["class_counts"][t].tolist() == expected.tolist()
            of_class = np.bincount(places, masses, LAYOUT.classes)
            np.testing.assert_allclose(census["class_masses"][t], of_class, rtol=1e-12)
            assert census["largest_masses"][t] == masses.max()


def test_a_range_has_the_censuses_of_single_samples():
    scene = SMALL_SCENES["event, different sizes"]
    results = new_results(5, LAYOUT)
    simulate_samples(scene, key_words(KEY), 2, new_watch(np.zeros(1, np.uint8)), results)
    assert set(results.records["state"].tolist()) == {COMPLETED}
    for name, together in census_values(results.census).items():
        for k in range(5):
            assert together[k].tobytes() == counted(scene, 2 + k)[2][name].tobytes()


def test_classes_at_the_ends_take_what_lies_beyond():
    scene = SMALL_SCENES["event"]
    room = new_census_room(CensusLayout.between((math.inf,), 1.0, 1.0), 1)
    record, _ = simulate_counted(scene, generator(*KEY, 0), room)
    assert room.counts.sum() == record["particles"]
    assert room.masses.sum() == pytest.approx(scene.particles * scene.mass, rel=1e-12)


@pytest.mark.parametrize(("smallest", "largest"), [(1.0, 4.6), (0.01, 30.0), (1.0, 1.0)])
def test_classes_are_narrow_and_reach_both_ends(smallest, largest):
    edges = CensusLayout.between((math.inf,), smallest, largest).edges
    assert edges[0] < smallest
    assert edges[-1] > largest
    assert (edges[1:] / edges[:-1]).max() <= 1.02 * (1 + 1e-12)
    middle = np.searchsorted(edges, 1.0) - 1  # equal grains are in the middle of a class
    assert math.sqrt(edges[middle] * edges[middle + 1]) == pytest.approx(1.0, rel=1e-12)
