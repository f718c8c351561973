"""Control volume and end time."""

import numpy as np
import pytest
from accuracy_rows import made_up

from agglom_mpi.accuracy import control_volume as module
from agglom_mpi.accuracy.time_integration import EVENT
from agglom_mpi.config.loading import load_campaign


@pytest.fixture(scope="module")
def campaign():
    return load_campaign("jobs/quickstart.yaml")


def test_another_number_of_particles_changes_nothing_but_the_control_volume(campaign):
    own = campaign.scene.build(campaign.parameters())
    setups = module.setups(campaign, campaign.parameters(), 9, quick=False)
    for number in module.numbers(campaign, quick=False):
        setup = setups[module.name_of_number(number)]
        scene = setup.campaign.scene.build(setup.parameters, setup.engine)
        assert scene.particles == number
        assert scene.radius == pytest.approx(own.radius, rel=1e-14)
        assert scene.mass == pytest.approx(own.mass, rel=1e-14)
        assert scene.end_time == own.end_time
        density = scene.particles / scene.half_width**3
        assert density == pytest.approx(own.particles / own.half_width**3, rel=1e-13)


def test_another_end_time_changes_nothing_but_the_end(campaign):
    own = campaign.scene.build(campaign.parameters())
    setups = module.setups(campaign, campaign.parameters(), 9, quick=True)
    for factor in module.QUICK_TIMES:
        setup = setups[module.name_of_time(factor)]
        scene = setup.campaign.scene.build(setup.parameters, setup.engine)
        assert scene == own._replace(end_time=factor * own.end_time)


def test_the_limit_of_many_grains_is_that_of_a_law_linear_in_inverse_n(campaign):
    random, own = np.random.default_rng(3), campaign.scene.particles
    by_number = {EVENT: own} | {
        module.name_of_number(n): n for n in module.numbers(campaign, quick=False)
    }
    names = [EVENT, *module.setups(campaign, campaign.parameters(), 1, quick=False)]
    samples = {}
    for name in names:
        number = by_number.get(name, own)
        noise = random.normal(size=400)
        noise -= noise.mean()
        samples[name] = made_up(1.8 + 12.0 / number + noise / np.sqrt(number), 1e-6 * number)
    sizes, _ = module.measure(campaign, campaign.parameters(), samples, quick=False)
    assert module.limit_of(sizes).limit.value == pytest.approx(1.8, abs=1e-9)
    found = module.control_volume_section(campaign, campaign.parameters(), samples, quick=False)
    assert "box_finite_size" in [figure.name for figure in found.figures]


def test_each_end_time_has_the_mean_error_and_time_of_its_own_samples(campaign):
    random, parameters = np.random.default_rng(2), campaign.parameters()
    names = [EVENT, *module.setups(campaign, parameters, 1, quick=True)]
    samples = {name: made_up(2.0 + 0.1 * random.normal(size=100)) for name in names}
    later = 2.5 + 0.1 * random.normal(size=100)
    samples[module.name_of_time(2.0)] = made_up(later, 3e-3)
    _, times = module.measure(campaign, parameters, samples, quick=True)
    last = times.iloc[-1]
    assert last["end time (s)"] == pytest.approx(2.0 * times["end time (s)"].iloc[1], rel=1e-12)
    assert last["mean b/b0"] == pytest.approx(later.mean(), rel=1e-12)
    assert last["standard error"] == pytest.approx(later.std(ddof=1) / 10.0, rel=1e-9)
    assert last["processor time per sample (s)"] == pytest.approx(3e-3)
    found = module.control_volume_section(campaign, parameters, samples, quick=True)
    assert [len(table.frame) for table in found.tables] == [3, 3]
