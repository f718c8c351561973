import re

import numpy as np
import pytest
from campaign_runs import assert_same, assert_sound, decisions, finish, state
from scipy.stats import kstest, qmc
from set_runs import three_variable_text

from agglom_mpi import open_campaign
from agglom_mpi.config.campaign import Campaign
from agglom_mpi.config.yaml_source import CampaignError
from agglom_mpi.emulation.gaussian_process import GaussianProcess
from agglom_mpi.emulation.likelihood_fit import fit_covariance
from agglom_mpi.search.acquisition import SET_CANDIDATES, SetAim
from agglom_mpi.search.space import SearchSpace
from agglom_mpi.storage.reader import read_campaign

SEARCH = "{method: surrogate, initial: 32, batch: 16, aim: set}"


def square():
    lower, upper = np.full(10, np.nan), np.full(10, np.nan)
    lower[:2], upper[:2] = 0.0, 1.0
    return SearchSpace(lower, upper)


AIM = SetAim(0.1, lambda strings: strings[:, :2])


def observed(count, noise=0.1):
    """Signed means of x - 0.5, whose set is a stripe of a width of 0.2."""
    points = qmc.Sobol(2, seed=1).random(512)[:count]
    return points, points[:, 0] - 0.5 + noise * np.random.default_rng(2).normal(size=count)


class Known:
    """A process whose mean is a function of the first coordinate, and whose deviation is given."""

    def __init__(self, mean, deviation=0.01):
        self._mean, self._deviation = mean, deviation

    def mean(self, points):
        return self._mean(points[:, 0])

    def deviation(self, points):
        return np.full(len(points), self._deviation)


def stripe(x):
    return 2.0 * (x - 0.5)


STRIPE = Known(stripe)
"""Its set is 0.45 to 0.55, the neighbourhood of three tolerances 0.35 to 0.65."""


def drawn(model, count, seed=3, space=None):
    return AIM.batch(model, count, np.random.default_rng(seed), space or square())


@pytest.mark.parametrize("count", [2, 15, 16, 41])
def test_half_of_a_batch_is_in_the_neighbourhood_and_the_rest_where_membership_is_unsure(count):
    batch = drawn(STRIPE, count)
    assert batch.shape == (count, 2)
    assert len(np.unique(batch, axis=0)) == count
    away = np.abs(STRIPE.mean(batch))
    assert np.all(away[: count // 2] <= 3 * AIM.tolerance)
    # Seven deviations from the tolerance a point has a probability of a millionth of the floor.
    assert np.all(np.abs(away[count // 2 :] - AIM.tolerance) < 0.07)


def test_the_first_half_is_even_over_the_neighbourhood_whatever_the_doubt():
    for deviation in (1e-3, 0.1, 10.0):
        half = drawn(Known(stripe, deviation), 800)[:400]
        # The probability of a distance of 0.15 with 400 even points is 2 exp(-18).
        assert kstest(half[:, 0], "uniform", (0.35, 0.3)).statistic < 0.15
        assert kstest(half[:, 1], "uniform").statistic < 0.15


@pytest.mark.parametrize(("width", "near"), [(0.0, False), (0.001, True)])
def test_a_neighbourhood_with_fewer_candidates_than_half_a_batch_gives_all_of_them(width, near):
    model = Known(lambda x: np.where(x < width, 0.2, 5.0), 1.0)
    candidates = square().sample_points(np.random.default_rng(3), SET_CANDIDATES)
    few = candidates[candidates[:, 0] < width]
    assert near == (0 < len(few) < 30)
    batch = drawn(model, 60)
    assert len(np.unique(batch, axis=0)) == 60
    assert {*map(tuple, few)} == {*map(tuple, batch[: len(few)])}
    assert np.all((batch >= 0.0) & (batch <= 1.0))


def test_batches_obey_the_constraints():
    space = square().within(lambda strings: strings[:, 0] + strings[:, 1] < 0.9)
    batch = drawn(STRIPE, 200, space=space)
    assert len(batch) == 200
    assert space.allows(batch).all()


def test_a_batch_may_be_larger_than_the_usual_number_of_candidates():
    batch = drawn(STRIPE, SET_CANDIDATES + 1)
    assert len(np.unique(batch, axis=0)) == SET_CANDIDATES + 1


def test_batches_lie_where_membership_is_unsure():
    points, values = observed(64)
    ones = np.ones(64, np.int64)
    model = GaussianProcess(fit_covariance(points, values, ones), points, values, ones)
    batch = AIM.batch(model, 40, np.random.default_rng(3), square())
    assert batch.shape == (40, 2)
    # Both edges are 0.1 from the middle; errors of the model are about 0.03.
    assert np.mean(np.abs(np.abs(batch[20:, 0] - 0.5) - 0.1) < 0.1) > 0.8


def test_more_strings_make_the_error_smaller():
    errors = []
    for count in (64, 250):
        points, values = observed(count)
        strings = square().from_unit(points)
        errors.append(AIM.expected_error(strings, values, np.ones(count, np.int64), square()))
    assert 0.0 < errors[1] < errors[0] < 1.0


def test_too_few_strings_say_nothing_and_failed_ones_do_not_count():
    points, values = observed(60)
    values[:20] = np.nan
    strings, ones = square().from_unit(points), np.ones(60, np.int64)
    assert AIM.expected_error(strings, values, ones, square()) == np.inf


def text(stopping="{generations: 60, expected_error: 0.5}", search=SEARCH, **changed):
    base = three_variable_text(search=search, final="none", **changed)
    return re.sub(r"(?m)^stopping: .*$", f"stopping: {stopping}", base)


def test_a_campaign_ends_when_its_set_is_known_and_resumes_to_the_same(tmp_path):
    (tmp_path / "three.yaml").write_text(text())
    finish(tmp_path, "three.yaml")
    path = tmp_path / "three.h5"
    assert state(path) == ("finished", "the expected error of the set is at most 0.5")
    assert len(read_campaign(path).result_rows()) < 32 + 58 * 16
    assert open_campaign(path).feasible_set(0.05).expected_error < 0.65
    assert_sound(path)
    done = decisions(path)
    finish(tmp_path, "three.yaml")
    assert_same(path, done)


@pytest.mark.parametrize(
    ("changed", "said"),
    [
        ({"objective": "{law: maximum_growth}"}, "needs objective growth_target; it is maximum"),
        ({"search": "{method: surrogate, tolerance: 0.1}"}, "is that of a set; give aim: set"),
        ({"search": "{method: genetic}"}, "needs search {method: surrogate, aim: set}"),
    ],
)
def test_what_does_not_fit_a_set_is_refused(changed, said):
    with pytest.raises(CampaignError, match=said):
        Campaign.from_text(text(**changed))


def test_a_search_for_the_best_keeps_its_identity():
    plain = Campaign.from_text(text("{generations: 9}", "{method: surrogate}"))
    said = Campaign.from_text(text("{generations: 9}", "{method: surrogate, aim: best}"))
    assert plain.sha256() == said.sha256()
    assert "search.aim" not in plain.identity()
    assert "stopping.expected_error" not in plain.identity()


def test_the_description_says_what_ends_it():
    said = Campaign.from_text(text()).describe()
    assert "where it is unsure which strings are within 0.05 of it" in said
    assert "expected error of the set at most 0.5" in said
