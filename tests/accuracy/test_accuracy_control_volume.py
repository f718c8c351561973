"""Control volume."""

import numpy as np
import pytest
from accuracy_rows import frame_of, made_up

from agglom_mpi.accuracy.time_integration import control_volume as module
from agglom_mpi.accuracy.time_integration.steps import EVENT, StudiedScene
from agglom_mpi.config.loading import load_campaign


@pytest.fixture(scope="module")
def campaign():
    return load_campaign("jobs/quickstart.yaml")


def studied(campaign, quick):
    return StudiedScene(campaign, campaign.parameters(), 9, 9, quick)


def test_another_number_of_particles_changes_nothing_but_the_control_volume(campaign):
    own = campaign.scene.build(campaign.parameters())
    setups = module.control_volume_part(studied(campaign, False)).setups
    for number, name in module.compared_numbers(studied(campaign, False)).items():
        setup = setups[name]
        scene = setup.campaign.scene.build(setup.parameters, setup.engine)
        assert scene.particles == number
        assert scene.radius == pytest.approx(own.radius, rel=1e-14)
        assert scene.mass == pytest.approx(own.mass, rel=1e-14)
        assert scene.end_time == own.end_time
        density = scene.particles / scene.half_width**3
        assert density == pytest.approx(own.particles / own.half_width**3, rel=1e-13)


def test_the_limit_of_many_grains_is_that_of_a_law_linear_in_inverse_n(campaign):
    random, own = np.random.default_rng(3), campaign.scene.particles
    numbers = module.compared_numbers(studied(campaign, False))
    by_number = {EVENT: own} | {name: number for number, name in numbers.items()}
    names = [EVENT, *module.control_volume_part(studied(campaign, False)).setups]
    samples = {}
    for name in names:
        number = by_number.get(name, own)
        noise = random.normal(size=400)
        noise -= noise.mean()
        samples[name] = made_up(1.8 + 12.0 / number + noise / np.sqrt(number), 1e-6 * number)
    size = module.finite_size(studied(campaign, False), samples)
    assert size.volumes[0].grains == own
    assert size.growth.limit.value == pytest.approx(1.8, abs=1e-9)
    found = module.control_volume_part(studied(campaign, False)).section(samples)
    assert "box_finite_size" in [figure.name for figure in found.figures]


def test_each_number_of_particles_has_the_mean_and_time_of_its_own_samples(campaign):
    random = np.random.default_rng(2)
    part = module.control_volume_part(studied(campaign, True))
    samples = {n: made_up(2.0 + 0.1 * random.normal(size=100)) for n in (EVENT, *part.setups)}
    later, name = 2.5 + 0.1 * random.normal(size=100), [*part.setups][-1]
    samples[name] = made_up(later, 3e-3)
    [table] = part.section(samples).tables
    last = frame_of(table).iloc[-1]
    assert last["mean b/b0"] == pytest.approx(later.mean(), rel=1e-12)
    assert last["standard error"] == pytest.approx(later.std(ddof=1) / 10.0, rel=1e-9)
    assert last["processor time per sample (s)"] == pytest.approx(3e-3)
