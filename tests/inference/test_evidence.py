"""Evidence of data: of linear problems by closed forms, and of any by a grid over the box."""

import math

import numpy as np
import pytest
from measured_runs import write_measured
from scipy.stats import multivariate_normal, norm
from toy_posteriors import linear_emulator, measurements

from agglom_mpi.config.loading import load_campaign
from agglom_mpi.emulation.blas_threads import single_threaded
from agglom_mpi.inference.data_posterior import posterior_of
from agglom_mpi.inference.evidence import Proposal, _constant, evidence_of
from agglom_mpi.inference.posterior_sampling import MIN_SIZE, SUFFICIENT_SIZE
from agglom_mpi.inference.searched_box import SearchedBox

SLOPES = np.array([[1.0, 0.0], [1.0, 1.0], [0.5, -0.5]])
TRUTH = np.array([0.45, 0.6])
ERRORS = np.array([0.05, 0.05, 0.08])


@single_threaded
def found_of(folder, slopes, data, **options):
    """Return posterior and evidence of data that are linear in the place in the box."""
    posterior = posterior_of(linear_emulator(folder, slopes, data, **options))
    return posterior, evidence_of(posterior.of, posterior)


def grid_logarithm(of, side=200):
    """Return the logarithm of the evidence by a grid of all directions of the data."""
    axis = (np.arange(side) + 0.5) / side
    places = np.stack(np.meshgrid(axis, axis), axis=-1).reshape(-1, 2)
    found = []
    for some in np.array_split(places, 20):
        strings = of.box.space.from_unit(some)
        away, covariances = of.framed_residuals(strings)
        squares = np.einsum("na,nab,nb->n", away, np.linalg.inv(covariances), away)
        _, logarithm = np.linalg.slogdet(2.0 * np.pi * covariances)
        failing = of.at(strings).failing
        with np.errstate(divide="ignore"):
            found.append(np.log(1.0 - failing) - 0.5 * (squares + logarithm))
    values = np.concatenate(found)
    return values.max() + math.log(np.mean(np.exp(values - values.max())))


@pytest.fixture(scope="module")
def linear(tmp_path_factory):
    data = measurements(1.0 + SLOPES @ TRUTH, ERRORS)
    return found_of(tmp_path_factory.mktemp("toy"), SLOPES, data, noise=1e-3)


def test_a_linear_problem_has_the_evidence_of_a_closed_form(linear):
    """A posterior inside of the box: the density in the plane of the values over its area there.

    Residuals off this plane vanish. Densities are those of data in units of their errors.
    """
    _, evidence = linear
    scaled = SLOPES / ERRORS[:, None]
    expected = -0.5 * math.log(2.0 * math.pi) - 0.5 * np.linalg.slogdet(scaled.T @ scaled)[1]
    # The box cuts off tails of no weight; what is left errs by the emulator, some 0.001.
    assert abs(evidence.logarithm - expected) < 4.0 * evidence.error + 0.03
    assert evidence.effective_size >= SUFFICIENT_SIZE
    assert 0.0 < evidence.error < 1.0 / math.sqrt(evidence.effective_size)


def test_the_evidence_is_that_of_a_grid_also_with_an_emulator_in_doubt(tmp_path):
    """At an end of the box, with failing strings, and with noise as large as the errors."""
    for i, (truth, noise, failing) in enumerate(
        [
            (TRUTH, 0.1, None),
            (np.array([0.02, 0.97]), 0.02, None),
            (TRUTH, 0.02, lambda u: u[:, 0] + u[:, 1] > 1.1),
        ]
    ):
        folder = tmp_path / str(i)
        folder.mkdir()
        data = measurements(1.0 + SLOPES @ truth + 0.5 * ERRORS, ERRORS)
        posterior, evidence = found_of(folder, SLOPES, data, noise=noise, failing=failing)
        away = evidence.logarithm - single_threaded(grid_logarithm)(posterior.of)
        assert abs(away) < 4.0 * evidence.error + 0.005


def test_data_that_no_string_explains_have_the_density_of_their_misfit(tmp_path):
    """A component that is not emulated, as strings do not differ in it, counts as all others."""
    slopes = np.array([[1.0, 0.0], [0.0, 0.0]])
    values = 1.0 + slopes @ TRUTH + np.array([0.0, 3.0 * 0.05])
    fitting = 1.0 + slopes @ TRUTH
    folders = tmp_path / "a", tmp_path / "b"
    for folder in folders:
        folder.mkdir()
    _, off = found_of(folders[0], slopes, measurements(values, [0.05, 0.05]), noise=1e-3)
    _, on = found_of(folders[1], slopes, measurements(fitting, [0.05, 0.05]), noise=1e-3)
    assert off.logarithm - on.logarithm == pytest.approx(-4.5, abs=0.1)


def test_a_box_of_twice_the_size_halves_the_evidence_for_each_variable_inside(tmp_path, linear):
    """The same truth in a box of twice the edges in units of the search, as it is stated."""
    posterior, evidence = linear
    assert evidence.open_ended == ()
    assert evidence.inside == posterior.of.box.names
    assert evidence.box_doubled == pytest.approx(-2.0 * math.log(2.0))
    # The values of the place u of the old box are those of 1/4 + u/2 in the new one, but for a
    # constant, which is added to the data, too.
    moved = measurements(1.0 + SLOPES @ (TRUTH + 0.5), ERRORS)
    larger = found_of(tmp_path, 2.0 * SLOPES, moved, noise=1e-3)[1]
    change = larger.logarithm - evidence.logarithm
    error = math.hypot(larger.error, evidence.error)
    assert abs(change - evidence.box_doubled) < 4.0 * error + 0.05


def test_variables_that_reach_an_end_are_not_counted_as_inside(tmp_path):
    """The first piles up at its lower end; of the second nothing is measured."""
    _, evidence = found_of(tmp_path, np.array([[1.0, 0.0]]), measurements([1.0], [0.1]))
    assert evidence.inside == ()
    assert len(evidence.open_ended) == 2
    assert evidence.box_doubled == 0.0


def test_proposals_have_the_density_that_is_stated():
    """The mean of 1/q over proposals in the box is the share of the box, 1."""
    random = np.random.default_rng(1)
    places = random.normal(0.5, 0.05, (500, 2))
    proposal = Proposal(places, np.full(500, 1.0 / 500.0), random)
    drawn = proposal.draw(20_000, random)
    inside = ((drawn >= 0.0) & (drawn <= 1.0)).all(axis=1)
    inverse = np.zeros(len(drawn))
    inverse[inside] = 1.0 / proposal.density(drawn[inside])
    assert abs(inverse.mean() - 1.0) < 4.5 * inverse.std() / math.sqrt(len(drawn))
    wide = norm.pdf(drawn[inside], 0.5, 0.2).prod(axis=1) * inverse[inside]
    expected = (2.0 * norm.cdf(2.5) - 1.0) ** 2
    assert abs(wide.sum() / len(drawn) - expected) < 4.5 * wide.std() / math.sqrt(len(drawn))


def test_constraints_of_the_box_are_part_of_the_prior(tmp_path):
    """Half of the box is excluded, and none of the posterior: the evidence doubles."""
    box = SearchedBox(load_campaign(write_measured(tmp_path)))
    middle = math.sqrt(0.01 * 0.3)
    folder = tmp_path / "less"
    folder.mkdir()
    path = write_measured(folder)
    path.write_text(f"{path.read_text()}constraints: [relative_speed < {middle!r} m/s]\n")
    less = SearchedBox(load_campaign(path))
    assert len(less.allowed_even_strings(1024)) == 512 == len(box.allowed_even_strings(1024)) // 2
    found = []
    for each in (box, less):
        inner = tmp_path / each.campaign.name.replace("/", "_").replace(".", "_")
        inner.mkdir()
        data = measurements([1.2], [0.02])
        of = linear_emulator(inner, np.array([[1.0, 0.0]]), data, noise=1e-3)
        of.box = each
        posterior = single_threaded(posterior_of)(of)
        found.append(single_threaded(evidence_of)(of, posterior))
    change = found[1].logarithm - found[0].logarithm
    assert abs(change - math.log(2.0)) < 4.0 * math.hypot(*(e.error for e in found)) + 0.01
    assert all(each.effective_size > MIN_SIZE for each in found)


def test_the_density_of_all_data_is_normal(linear):
    """One string: what the evidence averages, against SciPy's normal distribution."""
    posterior, _ = linear
    of = posterior.of
    [away], [covariance] = of.framed_residuals(posterior.strings[:1])
    expected = multivariate_normal(np.zeros(len(away)), covariance).logpdf(away)
    assert of.log_density(posterior.strings[:1])[0] + _constant(of) == pytest.approx(expected)
