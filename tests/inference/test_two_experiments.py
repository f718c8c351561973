"""The posterior of two experiments, and after a third one, beside direct simulations."""

import numpy as np
import pytest
from direct_simulations import (
    SimulatedGrid,
    drawn_posterior,
    level_of,
    measured_anew,
    predicted,
    volume_after,
    with_measurement,
    with_values,
)
from two_experiments import drawn_truths, write_two

from agglom_mpi.campaign_runs import load_campaign
from agglom_mpi.emulation.blas_threads import single_threaded
from agglom_mpi.inference.data_posterior import data_posterior
from agglom_mpi.storage.reader import read_campaign

pytestmark = pytest.mark.slow(guard="inference/test_contributions.py")

TRUTHS = 20


def posterior_in(folder, *arguments):
    path = write_two(folder, *arguments)
    load_campaign(path).run(output=path.with_suffix(".h5"), progress=False)
    return data_posterior(read_campaign(path.with_suffix(".h5")))


@pytest.fixture(scope="module")
def rough(tmp_path_factory):
    """Return the posterior of polished and rough grains."""
    return posterior_in(tmp_path_factory.mktemp("rough"), (0.22, 0.48))


@single_threaded
def test_the_marginals_are_those_of_direct_simulations_on_a_grid(rough):
    assert rough.calibration.passed
    grid = SimulatedGrid(rough.of, rough, samples=10)
    assert grid.outside < 0.02
    excess, distances = grid.compared(degree=4)
    assert np.all(excess < 1.5)
    assert max(distances) <= 0.06


def test_two_experiments_decide_what_each_leaves_undecided(rough):
    film, _ = rough.of.box.names
    widths = {each.label: each.contraction[film] for each in rough.contributions}
    assert widths["all"] < 0.75
    assert min(widths["without polished"], widths["without rough"]) > 0.9


@single_threaded
def test_90_per_cent_regions_hold_truths_that_are_simulated(rough):
    """Of 20 truths from the box 18 ± 1.34; all posteriors rest on the samples of one file."""
    of, random, levels = rough.of, np.random.default_rng(3), []
    for string in drawn_truths(of.box, TRUTHS, random):
        means = predicted(of.box.campaign, string, of.data, samples=100).mean(axis=0)
        made = with_values(of, measured_anew(of, means, random))
        levels.append(level_of(made, drawn_posterior(made), string))
    assert np.sum(np.array(levels) < 0.9) > 18 - 4.5 * 1.34
    assert np.mean(levels) == pytest.approx(0.5, abs=4.5 / np.sqrt(12 * TRUTHS))


@single_threaded
def test_the_next_experiment_leaves_the_volume_that_was_expected(tmp_path):
    """An experiment without data is ranked first; it is simulated at truths of the posterior."""
    posterior = posterior_in(tmp_path, (0.22, 0.35), False)
    found = posterior.next_measurements()
    each = found.ranked[0]
    assert each.datum.experiment == "rough"
    assert each.after.value < 0.8 * found.volume
    emulated, random = with_measurement(posterior, each), np.random.default_rng(5)
    truths = random.choice(len(posterior.weights), TRUTHS, p=posterior.weights)
    volumes = []
    for string in posterior.strings[truths]:
        own = predicted(posterior.of.box.campaign, string, emulated.data[-1:], samples=100)
        volumes.append(volume_after(emulated, own.mean(axis=0), random))
    assert np.mean(volumes) == pytest.approx(each.after.value, rel=0.3)
