"""Sets of other objectives than a growth target."""

import numpy as np
import pytest
from set_runs import three_variable_file

from agglom_mpi import open_campaign
from agglom_mpi.verbs.estimate import estimate

SLOW, FAST = {"relative_speed": 0.5}, {"relative_speed": 28.0}
REST = {"hardness": 2e7, "friction": 0.3}


@pytest.fixture(scope="module")
def growth(tmp_path_factory):
    folder = tmp_path_factory.mktemp("maximum")
    path = three_variable_file(folder, objective="{law: maximum_growth}", generations=7)
    return open_campaign(path).feasible_set(0.1)


@pytest.fixture(scope="module")
def moments(tmp_path_factory):
    folder = tmp_path_factory.mktemp("moments")
    law = "{law: moments, targets: {mean: 2, spread: 0.6}}"
    path = three_variable_file(folder, objective=law, generations=7)
    return open_campaign(path).feasible_set(0.2)


def test_strings_near_the_maximum_are_members(growth):
    assert growth.probability(FAST | REST)[0] > growth.probability(SLOW | REST)[0]
    assert growth.probability(SLOW | REST)[0] < 0.1
    largest, error = growth.maximum
    assert 2.0 < largest < 100 ** (1 / 3)
    assert 0.0 < error < 1.0
    assert growth.mean(FAST | REST)[0] < largest + 3.0 * error
    assert growth.bounds == pytest.approx((0.9 * largest, np.inf))


def test_a_maximum_is_uncertain_and_so_is_its_set(growth):
    assert 0.0 < growth.inner <= growth.volume <= growth.outer <= 1.0
    assert growth.volume_error > 0.0


def test_moments_are_told_one_by_one_with_their_deviations(moments):
    both = moments.mean({"relative_speed": np.array([2.0, 4.3]), "hardness": 67e6, "friction": 0.3})
    assert both.shape == (2, 2)
    assert moments.criterion.quantities == ("mean", "spread")
    assert (np.diff(both[:, 0]) > 0.0).all()
    deviation = moments.deviation({"relative_speed": 4.3, "hardness": 67e6, "friction": 0.3})
    assert (deviation > 0.0).all()


def test_moments_are_those_of_many_samples(moments):
    at = {"relative_speed": 4.3, "hardness": 67e6, "friction": 0.3}
    reached = estimate(moments.emulated.box.campaign, at, samples=200).moments
    mean, deviation = moments.mean(at)[0], moments.deviation(at)[0]
    for each, found, unsure in zip(reached, mean, deviation, strict=True):
        # The mean of 160 samples all over the box, and that the spread of few particles is skewed.
        assert abs(found - each.value) < 4.0 * np.hypot(unsure, each.error) + 0.02


def test_members_have_all_moments_at_once(moments):
    assert 0.0 < moments.volume < 0.5
    assert moments.directions["share"].sum() == pytest.approx(1.0)


def test_the_nearest_string_to_a_maximum_is_where_the_mean_is_largest(growth):
    found = growth.nearest
    means = growth.emulated.mean(growth.emulated.box.even_strings(1 << 12))[:, 0]
    assert found.mean["mean_radius_ratio"] >= means.max() - 1e-9
    assert not growth.empty


def test_the_nearest_string_to_moments_has_all_of_them(moments):
    found = moments.nearest
    assert list(found.mean) == list(found.deviation) == ["mean", "spread"]
    assert found.probability > 0.5
    assert found.away < 1.645
    assert not found.out_of_reach
    assert found.reached.startswith("mean ")
    assert ", spread " in found.reached


def test_what_moments_reach_is_drawn_one_by_one(moments):
    pytest.importorskip("matplotlib")
    from matplotlib.figure import Figure

    from agglom_mpi.report.figures.set_figures import draw_reach

    axes = draw_reach(Figure(), moments)
    assert [ax.get_xlabel() for ax in axes] == ["mean", "spread"]
