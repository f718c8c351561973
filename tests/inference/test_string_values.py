import math

import numpy as np
import pytest
from measured_samples import drawn_census

from agglom_mpi.inference.stored_samples import pseudo_values, stored_samples, string_values
from agglom_mpi.measurements.datum import Datum, predictions
from agglom_mpi.measurements.misfit import sampling_noise
from agglom_mpi.storage.reader import read_campaign
from agglom_mpi.storage.recorded_campaign import recorded_campaign

CLASSES = np.array([0.0, 0.8e-4, 1e-4, 1.3e-4, np.inf])
DATA = (
    Datum("sizes", np.full(4, 0.25), np.eye(4), "mass", edges=CLASSES),
    Datum.of_value("d50", 1e-4, 1e-5),
    Datum.of_value("temperature", 300.0, 1.0),
)


@pytest.fixture(scope="module")
def measured(measured_file):
    return read_campaign(measured_file)


def test_the_variance_of_mean_pseudo_values_is_that_of_the_jackknife():
    census = drawn_census(7, np.random.default_rng(3))
    values = pseudo_values(census, DATA)
    noise = sampling_noise(predictions(census, DATA).left_out)
    assert values.shape == (7, 6)
    assert np.cov(values.T) / 7 == pytest.approx(noise.raw, rel=1e-9, abs=1e-30)


def test_pseudo_values_of_shares_sum_to_one():
    values = pseudo_values(drawn_census(5, np.random.default_rng(4)), DATA)
    assert values[:, :4].sum(axis=1) == pytest.approx(np.ones(5))


def test_the_mean_of_pseudo_values_has_less_bias_than_the_pooled_prediction():
    """D[4,3] of few lognormal particles is a ratio of sums, too small by a part of order 1/n."""
    data = (Datum.of_value("d43", 1e-4, 1e-5),)
    random = np.random.default_rng(5)
    censuses = [drawn_census(3, random, log_spread=0.5, grains=20) for _ in range(2000)]
    pooled = np.array([predictions(c, data).pooled[0] for c in censuses])
    corrected = np.array([pseudo_values(c, data).mean() for c in censuses])
    expected = 1e-4 * math.exp(3.5 * 0.5**2)
    errors = [each.std() / math.sqrt(len(each)) for each in (pooled, corrected)]
    assert expected - pooled.mean() > 4.0 * errors[0]
    assert abs(expected - corrected.mean()) < expected - pooled.mean() - 2.0 * sum(errors)


def test_every_completed_sample_of_a_file_has_its_values(measured):
    stored, campaign = stored_samples(measured), recorded_campaign(measured)
    found = string_values(measured, campaign.data, stored)
    assert len(found.strings) == len(found.values) == len(stored.rows)
    assert (stored.rows["sample"] >= measured.fresh_from).any()
    string = np.nan_to_num(found.strings[0])  # nan: a variable that the scene does not use
    mine = (np.nan_to_num(found.strings) == string).all(axis=1)
    theirs = stored.rows[(np.nan_to_num(stored.strings) == string).all(axis=1)]
    law = campaign.objective_at(found.strings[0])
    pooled = law.predictions(law.summaries(theirs)).pooled
    assert mine.sum() == len(theirs)
    assert found.values[mine].mean(axis=0) == pytest.approx(pooled, rel=0.1, abs=0.05)


def test_a_string_with_one_sample_has_its_predictions(measured):
    stored, campaign = stored_samples(measured), recorded_campaign(measured)
    one = stored._replace(rows=stored.rows[:1], strings=stored.strings[:1])
    found, law = string_values(measured, campaign.data, one), campaign.objective_at(one.strings[0])
    assert found.values == pytest.approx(
        law.predictions(law.summaries(one.rows)).pooled[None], rel=1e-12
    )


def test_values_of_any_quantity_at_a_time_of_the_censuses(measured):
    data = (
        Datum.of_value("d90", 1e-4, 1e-6, "mass"),
        Datum.of_value("particles_left", 0.3, 0.1, time=2e-3),
    )
    found, turned = string_values(measured, data), string_values(measured, data[::-1])
    assert np.array_equal(found.values, turned.values[:, ::-1])
    rounding = 4.0 * np.finfo(float).eps  # of a mean of samples that keep all their grains
    assert np.all(found.values[:, 1] <= 1.0 + rounding)
    early, late = (
        string_values(measured, (Datum.of_value("particles_left", 0.3, 0.1, time=time),)).values
        for time in (2e-3, None)
    )
    assert early.mean() > late.mean()


def test_a_time_without_a_census_is_refused(measured):
    with pytest.raises(ValueError, match=r"0\.001 s.*0\.002 s, the end"):
        string_values(measured, (Datum.of_value("d50", 1e-4, 1e-5, time=1e-3),))


def test_a_campaign_without_data_has_no_values(three):
    with pytest.raises(ValueError, match=r"three\.h5"):
        string_values(read_campaign(three.path), DATA)
