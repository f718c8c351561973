"""`campaign.simulate(…, frames=…)`: what may be asked for, and what comes back."""

import numpy as np
import pytest
from frame_runs import bits
from scenes import breaking_event_periodic

from agglom_mpi.config.campaign import Campaign
from agglom_mpi.config.yaml_source import CampaignError
from agglom_mpi.random_streams import sample_stream
from agglom_mpi.simulation.frames import frame_times
from agglom_mpi.simulation.sample import simulate_scene
from agglom_mpi.verbs.simulate import simulate

TEXT = """\
title: frames
seed: 3
scene:
  particles: 30
  half_width: 1 cm
  velocities: {law: spread, mean: [10, 10, 100], transverse: 0.5}
  restitution: pressure
  duration: {law: compression_recovery, length_ratio: 1e-6}
  contact_area: {initial: 0, final: 1}
  hardness: arrhenius
  friction: constant
  heating: pair_split
  reaction: contact_area
  fragmentation: pair_energy
  cooling: {law: radiation, emissivity: 0.5, surroundings: 300 K}
  end_time: 5 ms
variables:
  relative_speed: 20
  size_ratio: 0.7
  density: 5000
  hardness: 4e10
  heat_capacity: 500
  friction: 0.2
  temperature: 500
  activation_energy: 700
  reaction_heat: 100
  surface_energy: 1e16
"""
"""A scene of the type that `breaking_event_periodic` has, which is compiled anyway."""

CAMPAIGN = Campaign.from_text(TEXT)
END = 5e-3


@pytest.mark.plain
def test_so_many_frames_are_evenly_spaced_and_change_nothing():
    plain, seen = simulate(CAMPAIGN, {}, 4), simulate(CAMPAIGN, {}, 4, frames=11)
    assert plain.frames is None
    assert plain.merges > 3
    assert seen.record.tobytes() == plain.record.tobytes()
    np.testing.assert_allclose(seen.frames.times, np.arange(11) * END / 10.0, rtol=1e-15)
    assert (seen.frames.times[0], seen.frames.times[-1]) == (0.0, END)
    assert seen.frames.positions.shape == seen.frames.velocities.shape == (11, 30, 3)
    for each in ("labels", "radii", "masses", "temperatures", "grains"):
        assert getattr(seen.frames, each).shape == (11, 30)
    assert seen.frames.particles.tolist()[0] == 30
    assert seen.frames.particles.tolist()[-1] == seen.particles == plain.particles


@pytest.mark.plain
def test_frames_of_a_measured_campaign_leave_its_census_and_objective():
    data = "data: [{quantity: particles_left, value: 0.5, error: 0.1, time: 2 ms}]\n"
    measured = Campaign.from_text(f"{TEXT}{data}objective: misfit\n")
    plain, seen = simulate(measured, {}, 4), simulate(measured, {}, 4, frames=3)
    assert seen.frames is not None
    np.testing.assert_equal(seen.objective, plain.objective)  # nan: one sample has no noise
    assert all(map(np.array_equal, seen.census, plain.census))


@pytest.mark.plain
@pytest.mark.parametrize("times", [[0.0, 1e-3, END], np.array([1e-3]), (END,)])
def test_frames_are_taken_at_the_times_given(times):
    seen = simulate(CAMPAIGN, {}, 4, frames=times)
    assert seen.frames.times.tolist() == list(times)
    assert np.all(seen.frames.particles > 0)


def test_the_final_particles_are_always_there():
    outcome = simulate(CAMPAIGN, {}, 4)
    scene = CAMPAIGN.scene.build(CAMPAIGN.parameters())
    assert type(scene.laws) is type(
        breaking_event_periodic(particles=2, size_ratio=0.1, end_time=1.0).laws
    )
    random = sample_stream(CAMPAIGN.seed, CAMPAIGN.parameters(), 4)
    _, particles = simulate_scene(scene, random)
    n = outcome.particles
    assert outcome.final.radii.tobytes() == bits(particles)[2]
    assert outcome.final.masses.tobytes() == bits(particles)[3]
    assert outcome.final.temperatures.tobytes() == bits(particles)[4]
    assert outcome.final.grains.tobytes() == bits(particles)[5]
    assert len(outcome.final.grains) == n < 30
    assert outcome.final.grains.sum() == 30
    np.testing.assert_allclose(outcome.final.radii / scene.radius, outcome.radii, rtol=1e-15)
    assert outcome.temperatures.tobytes() == outcome.final.temperatures.tobytes()


@pytest.mark.parametrize(
    ("frames", "message"),
    [
        (-1, "frames: are -1; must be at least 1"),
        (0, "frames: are 0; must be at least 1"),
        (2.5, "frames: are 2.5; must be how many, or a sequence of times in s"),
        (True, "frames: are True; must be how many, or a sequence of times in s"),
        ("many", "frames: are 'many'; must be how many, or a sequence of times in s"),
        ([], "frames: are []; must be how many, or a sequence of times in s"),
        ([[0.0], [1e-3]], "frames: are [[0.0], [0.001]]; must be how many, or a sequence"),
        ([0.0, "soon"], "frames: are [0.0, 'soon']; must be how many, or a sequence of times in s"),
        ([-1e-9, 1e-3], "frames: have one at -1e-09 s; must be from 0 to 0.005 s"),
        ([0.0, 6e-3], "frames: have one at 0.006 s; must be from 0 to 0.005 s"),
        ([0.0, float("nan")], "frames: have one at nan s; must be from 0 to 0.005 s"),
        ([2e-3, 1e-3], "frames: have one at 0.001 s after one at 0.002 s; must ascend"),
        ([1e-3, 1e-3], "frames: have one at 0.001 s after one at 0.001 s; must ascend"),
    ],
)
def test_impossible_frames_are_one_clear_error(frames, message):
    with pytest.raises(CampaignError) as caught:
        simulate(CAMPAIGN, {}, frames=frames)
    assert str(caught.value).startswith(f"campaign.yaml: {message}")


def test_a_single_frame_is_the_start():
    assert frame_times(1, END).tolist() == [0.0]
    assert frame_times(np.int64(2), END).tolist() == [0.0, END]
