import re

import numpy as np
import pytest
from campaign_runs import assert_same, assert_sound, decisions, finish, state
from scipy.stats import qmc
from set_runs import three_variable_text

from agglom_mpi import open_campaign
from agglom_mpi.config.campaign import Campaign
from agglom_mpi.config.yaml_source import CampaignError
from agglom_mpi.search.gaussian_process import GaussianProcess, fit_covariance
from agglom_mpi.search.set_aim import SetAim
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


def test_batches_lie_where_membership_is_unsure():
    points, values = observed(64)
    ones = np.ones(64, np.int64)
    model = GaussianProcess(fit_covariance(points, values, ones), points, values, ones)
    batch = AIM.batch(model, 40, np.random.default_rng(3), square())
    assert batch.shape == (40, 2)
    # Both edges are 0.1 from the middle; errors of the model are about 0.03.
    assert np.mean(np.abs(np.abs(batch[:, 0] - 0.5) - 0.1) < 0.1) > 0.8


def test_more_strings_make_the_error_smaller():
    errors = []
    for count in (64, 400):
        points, values = observed(count)
        strings = square().from_unit(points)
        errors.append(AIM.expected_error(strings, values, np.ones(count, np.int64), square()))
    assert 0.0 < errors[1] < errors[0] < 1.0


def test_too_few_strings_say_nothing_and_failed_ones_do_not_count():
    points, values = observed(60)
    values[:20] = np.nan
    strings, ones = square().from_unit(points), np.ones(60, np.int64)
    assert AIM.expected_error(strings, values, ones, square()) == np.inf


def text(stopping="{generations: 60, expected_error: 0.35}", search=SEARCH, **changed):
    base = three_variable_text(search=search, final="none", **changed)
    return re.sub(r"(?m)^stopping: .*$", f"stopping: {stopping}", base)


def test_a_campaign_ends_when_its_set_is_known_and_resumes_to_the_same(tmp_path):
    (tmp_path / "three.yaml").write_text(text())
    finish(tmp_path, "three.yaml")
    path = tmp_path / "three.h5"
    assert state(path) == ("finished", "the expected error of the set is at most 0.35")
    assert len(read_campaign(path).result_rows()) < 32 + 58 * 16
    assert open_campaign(path).feasible_set(0.05).expected_error < 0.45
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
    assert "where it is unsure which strings are within 0.05 of the target" in said
    assert "expected error of the set at most 0.35" in said
