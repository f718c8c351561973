"""Estimates on fresh samples: their 95 % intervals, what failed samples do, and the order."""

import math

import numpy as np
import pytest
from goals import growth_target, maximum_growth
from scipy import stats
from storage_rows import make, put_result, put_strings, sample_rows

from agglom_mpi.analysis.estimates import interval, objective_of
from agglom_mpi.analysis.ranking import order_by_estimates
from agglom_mpi.campaign_file import open_campaign
from agglom_mpi.storage.reader import read_campaign
from agglom_mpi.storage.writer import CampaignWriter

REPEATS = 5000
FRESH = 20
TARGET = {"scene.particles": 100, "objective.law": "growth_target", "objective.ratio": 2.0}


def coverage(law, pool, samples, seed):
    """Share of intervals from so many samples of a pool that cover the objective of all of it."""
    draws = np.random.default_rng(seed).integers(len(pool), size=(REPEATS, samples))
    truth = abs(law.deviation(pool).mean())
    covered = 0
    for deviations in law.deviation(pool)[draws]:
        error = deviations.std(ddof=1) / math.sqrt(samples)
        lower, upper = interval(abs(deviations.mean()), error, samples)
        covered += lower <= truth <= upper
    return covered / REPEATS


def spread(share):
    """Four standard errors of a share of `REPEATS`."""
    return 4.0 * math.sqrt(share * (1.0 - share) / REPEATS)


def skewed_coverage(pool, samples):
    """Coverage of a 95 % t interval, up to terms of 1/samples² (Hall 1983), here of some 1e-3.

    The skewness and excess kurtosis of the samples take it away from 95 %.
    """
    skewness, kurtosis = stats.skew(pool), stats.kurtosis(pool)
    z = stats.norm.ppf(0.975)
    off = kurtosis * (z**2 - 3.0) / 12.0 - skewness**2 * (z**4 + 2.0 * z**2 - 3.0) / 18.0
    return 0.95 + 2.0 * z * stats.norm.pdf(z) * off / samples


@pytest.mark.parametrize("law", [growth_target(2.0), maximum_growth(1000)])
@pytest.mark.parametrize("samples", [30, 100])
def test_intervals_cover_as_often_as_theory_says_of_skewed_samples(law, samples):
    pool = 1.2 + np.random.default_rng(4).gamma(4.0, 0.1, 100_000)
    wanted = skewed_coverage(pool, samples)
    assert wanted < 0.949
    assert abs(coverage(law, pool, samples, samples) - wanted) < spread(wanted) + 1.0 / samples**2


def magnitude_coverage(distance, samples):
    """Coverage of the interval of |mean| of normal samples, at so many standard errors from 0.

    It covers where the t interval of the mean holds the mean or, instead of it, its negative:
    mean - h > m >= -mean - h and m <= h - mean for half a width h, integrated over h.
    """
    steps = (np.arange(20_000) + 0.5) / 20_000
    spread = np.sqrt(stats.chi2.ppf(steps, samples - 1) / (samples - 1))
    half = stats.t.ppf(0.975, samples - 1) * spread
    most, least = np.minimum(half - distance, distance - half), -distance - half
    other = stats.norm.cdf(most - distance) - stats.norm.cdf(least - distance)
    return 0.95 + np.mean(np.maximum(other, 0.0))


@pytest.mark.parametrize("distance", [0.0, 0.5, 1.0, 2.0, 4.0])
def test_intervals_of_a_magnitude_near_zero_cover_as_often_as_theory_says(distance):
    samples, ratios = 10, np.random.default_rng(5).normal(2.0, 0.2, 100_000)
    pool = ratios + 2.0 - ratios.mean() + distance * ratios.std() / math.sqrt(samples)
    wanted = magnitude_coverage(distance, samples)
    assert 0.95 <= wanted < 0.9751
    assert abs(coverage(growth_target(2.0), pool, samples, 6) - wanted) < spread(wanted)


def test_an_interval_that_holds_zero_begins_there():
    t = stats.t.ppf(0.975, 9)
    assert interval(0.1, 0.1, 10) == (0.0, pytest.approx(0.1 + 0.1 * t))
    assert interval(1.0, 0.1, 10) == (pytest.approx(1.0 - 0.1 * t), pytest.approx(1.0 + 0.1 * t))
    assert np.isnan(interval(1.0, math.nan, 1)).all()
    assert np.isnan(interval(math.inf, 0.1, 10)).all()


@pytest.fixture
def path(tmp_path):
    """Return a file of four judged strings, the lower the better; 0 to 2 are estimated again."""
    path = make(tmp_path / "final.h5", identity=TARGET, fresh=FRESH)
    with CampaignWriter(path) as writer:
        put_strings(writer, 0, 5)
        for string in range(4):
            put_result(writer, string, 0.5 + 0.125 * string)
        for string, ratio in ((0, 1.3), (1, 2.2), (2, 2.0)):
            rows = sample_rows(string, 100, FRESH)
            rows["mean_radius_ratio"] = ratio + 0.02 * np.arange(FRESH)
            writer.put_samples(rows)
        used = sample_rows(3, 0, 10)
        writer.put_samples(used)
    return path


def change(path, string, numbers, **columns):
    """Put other rows in the place of fresh ones, as a run never does."""
    from agglom_mpi.storage.access import open_file
    from agglom_mpi.storage.table import Table

    with open_file(path, write=True) as file:
        table = Table(file, "samples", path)
        for number in numbers:
            place = string * (100 + FRESH) + 100 + number
            [row] = [table.rows.read(place, 1)]
            for name, value in columns.items():
                row[name] = value
            if columns:
                table.write(place, row)
            else:
                table.mark_absent(place, 1)


def test_estimates_are_of_fresh_samples_alone_in_order_of_rank(path):
    assert objective_of(read_campaign(path)) == growth_target(2.0).of_grains(100)
    table = open_campaign(path).estimates
    assert table["string"].tolist() == [2, 1, 0]
    assert table["samples"].tolist() == [FRESH] * 3
    middle = 0.01 * (FRESH - 1)
    assert table["mean_radius_ratio"].tolist() == pytest.approx(
        [2.0 + middle, 2.2 + middle, 1.3 + middle]
    )
    deviations = (2.0 + 0.02 * np.arange(FRESH)) / 2.0 - 1.0
    error = deviations.std(ddof=1) / math.sqrt(FRESH)
    best = table.iloc[0]
    assert best["objective"] == pytest.approx(deviations.mean(), rel=1e-12)
    assert best["standard_error"] == pytest.approx(error, rel=1e-12)
    low, high = stats.t.interval(0.95, FRESH - 1, deviations.mean(), error)
    assert (best["lower"], best["upper"]) == (pytest.approx(low), pytest.approx(high))
    assert (best["searched_objective"], best["searched_standard_error"]) == (0.75, 0.01)
    assert table.attrs["units"]["lower"] == "1"
    assert table["string"].dtype == np.int64


def test_the_best_are_those_with_the_best_estimates_and_then_the_others(path):
    best = open_campaign(path).best(4)
    assert best["string"].tolist() == [2, 1, 0, 3]
    assert best["objective"].tolist() == [0.75, 0.625, 0.5, 0.875]
    assert np.isfinite(best["estimate"]).tolist() == [True, True, True, False]


def test_each_column_of_the_best_is_of_one_kind_of_samples(path):
    file = open_campaign(path)
    best, again = file.best(4), file.estimates.set_index("string")
    for column, name in (
        ("estimate", "objective"),
        ("estimate_standard_error", "standard_error"),
        ("estimate_mean_radius_ratio", "mean_radius_ratio"),
    ):
        assert best[column].tolist()[:3] == again.loc[[2, 1, 0], name].tolist()
        assert np.isnan(best[column][3])
        assert best.attrs["units"][column] == "1"
    searched = file.strings.set_index("string").loc[best["string"]]
    for name in ("objective", "standard_error", "mean_radius_ratio"):
        assert best[name].tolist() == searched[name].tolist()
    assert open_campaign(path).best()["string"].tolist() == [2]


def test_failed_fresh_samples_are_left_out_and_counted(path):
    change(path, 2, [19], state=2, mean_radius_ratio=np.nan)
    change(path, 1, [19])
    with CampaignWriter(path) as writer:
        late = "took longer than max_seconds, 3 s"
        writer.log.put_failure(1, 119, rank=0, host="here", text=late)
        writer.log.put_failure(3, 4, rank=0, host="here", text=late)
    table = open_campaign(path).estimates
    assert table["string"].tolist() == [2, 1, 0]
    assert table["failed"].tolist() == [1, 1, 0]
    assert table["samples"].tolist() == [FRESH] * 3
    means = [2.0 + 0.02 * 9, 2.2 + 0.02 * 9]
    assert table["objective"][:2].tolist() == pytest.approx([abs(m / 2 - 1) for m in means])


def test_a_string_of_which_more_than_a_tenth_failed_comes_last(path):
    change(path, 2, [1, 3, 5], state=2)
    table = open_campaign(path).estimates
    assert table["string"].tolist() == [1, 0, 2]
    assert table["objective"][2] == math.inf
    assert table[["lower", "upper"]].iloc[2].isna().all()


def test_without_room_or_fresh_samples_there_are_no_estimates(tmp_path):
    for fresh in (0, 5):
        path = make(tmp_path / f"{fresh}.h5", fresh=fresh)
        assert (read_campaign(path).fresh_from, read_campaign(path).max_samples) == (
            100,
            100 + fresh,
        )
        assert len(open_campaign(path).estimates) == 0


def test_estimates_have_the_variables_of_their_strings(path):
    file = open_campaign(path)
    table, strings = file.estimates, file.strings.set_index("string")
    names = file.variables["name"].tolist()
    assert table.columns[: 1 + len(names)].tolist() == ["string", *names]
    for name in names:
        assert table[name].tolist() == strings[name][table["string"]].tolist()
        assert table.attrs["units"][name] == file.strings.attrs["units"][name]


def test_where_the_search_has_gone_on_the_order_is_its_own(path):
    with CampaignWriter(path) as writer:
        put_result(writer, 4, 0.05)
    file = open_campaign(path)
    assert file.best(5)["string"].tolist() == [4, 0, 1, 2, 3]
    assert order_by_estimates([], []) == []
