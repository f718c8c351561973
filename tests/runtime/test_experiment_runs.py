"""Runs of campaigns with several experiments: one sample has all, and each its own columns."""

import numpy as np
import pytest
from campaign_runs import assert_same, assert_sound, decisions, finish, invert, need_mpirun
from experiment_runs import FAST, FASTER, SLOW, THREE, write_experiments

from agglom_mpi.analysis.data_fit import data_fit, string_predictions
from agglom_mpi.campaign_file import open_campaign
from agglom_mpi.campaign_runs import load_campaign
from agglom_mpi.measurements.misfit import misfit
from agglom_mpi.outcome import (
    COMPLETED,
    FAILED,
    LEDGER,
    MAXIMA,
    OUTCOME,
    SUMMED,
    FailureReason,
    joined,
)
from agglom_mpi.storage.reader import read_campaign

TIMES = {"seconds", "cpu_seconds", "finished", "rank", "crc"}


def run(folder, experiments=THREE, **changes):
    write_experiments(folder, experiments, **changes)
    finish(folder, "experiments.yaml")
    return folder / "experiments.h5"


@pytest.fixture(scope="module")
def path(tmp_path_factory):
    return run(tmp_path_factory.mktemp("experiments"))


def columns_of(rows, experiment):
    """Return the columns of an experiment by their own names."""
    start = f"{experiment}."
    return {n.removeprefix(start): rows[n] for n in rows.dtype.names if n.startswith(start)}


def test_a_sample_has_what_each_experiment_gives_alone(path):
    file, campaign = read_campaign(path), load_campaign(path.with_suffix(".yaml"))
    for row in file.all_sample_rows()[:4]:
        number = campaign.first_sample(int(row["string"])) + int(row["sample"])
        for each in campaign.experiments:
            string = each.own(file.parameters[int(row["string"])])
            alone = campaign.experiment(each.name).simulate(string, number)
            columns = columns_of(row, each.name)
            assert all(columns[n].tobytes() == alone.record[n].tobytes() for n in OUTCOME.names)
            for values, name in zip(alone.census, list(columns)[len(OUTCOME) :], strict=True):
                assert np.array_equal(columns[name], values)


def test_columns_without_a_name_are_of_all_experiments_or_of_the_first(path):
    rows = read_campaign(path).all_sample_rows()
    names = "slow", "fast", "faster"
    for name in OUTCOME.names:
        own = np.array([columns_of(rows, each)[name] for each in names])
        expected = own.sum(0) if name in SUMMED else own.max(0) if name in MAXIMA else own[0]
        assert np.array_equal(rows[name], expected, equal_nan=own.dtype.kind == "f")
    assert set(LEDGER) == {*MAXIMA, *SUMMED} & set(LEDGER)


def test_the_misfit_is_over_the_data_of_all_experiments(path):
    file, campaign = read_campaign(path), load_campaign(path.with_suffix(".yaml"))
    string = int(open_campaign(path).best()["string"].iloc[0])
    fit, samples = data_fit(file, string)
    assert (samples, len(fit.parts)) == (6, 3)
    assert [part.datum.experiment for part in fit.parts] == ["slow", "slow", "fast"]
    law = campaign.objective_at(file.parameters[string])
    rows = file.sample_rows(string)
    censuses = [each.census for each in law.summaries(rows[rows["sample"] >= file.fresh_from])]
    whole = campaign.measured_at(file.parameters[string]).census(censuses)
    assert misfit(whole, campaign.data).value == pytest.approx(fit.value, rel=1e-12)
    _, predicted, _ = string_predictions(file, string)
    left = columns_of(rows[rows["sample"] >= file.fresh_from], "fast")["particles"].mean() / 40
    assert predicted[-1] == pytest.approx(left, rel=1e-12)


def test_an_experiment_that_is_added_changes_no_column_of_the_others(tmp_path, path):
    """A search of random strings proposes the same strings whatever was measured."""
    shared = {"search": ("{population: 6, parents: 2}", "{method: random, population: 6}")}
    found = {
        name: read_campaign(run(tmp_path / name, experiments, **shared)).all_sample_rows()
        for name, experiments in (("two", SLOW + FAST), ("three", FASTER + SLOW + FAST))
    }
    two, three = (rows[rows["sample"] < 3] for rows in found.values())
    for name in two.dtype.names:
        if name.startswith(("slow.", "fast.")):
            assert np.array_equal(two[name], three[name], equal_nan=two[name].dtype.kind == "f")


def test_equal_experiments_with_two_names_have_independent_samples(tmp_path):
    rows = read_campaign(run(tmp_path, SLOW + SLOW.replace("slow", "same"))).all_sample_rows()
    first, second = (columns_of(rows, name)["mean_radius_ratio"] for name in ("slow", "same"))
    assert np.mean(first == second) < 0.5
    strings = rows["string"]
    for string in np.unique(strings):  # they are samples of one distribution
        one, other = first[strings == string], second[strings == string]
        spread = np.hypot(one.std(ddof=1), other.std(ddof=1)) / np.sqrt(len(one))
        assert abs(one.mean() - other.mean()) < 8.0 * spread + 0.3


def test_a_sample_fails_where_one_of_its_experiments_does():
    records = np.zeros(3, OUTCOME)
    records["state"], records["reason"] = COMPLETED, 0
    records["steps"], records["energy_error"] = [1, 2, 3], [0.1, 0.3, 0.2]
    whole = joined(records)
    assert (whole["state"], whole["steps"], whole["energy_error"]) == (COMPLETED, 6, 0.3)
    records["state"][2], records["reason"][2] = FAILED, FailureReason.BUDGET_EXCEEDED
    whole = joined(records)
    assert (whole["state"], whole["reason"]) == (FAILED, FailureReason.BUDGET_EXCEEDED)


def test_an_experiment_that_fails_has_no_census(tmp_path):
    short = FAST.replace("end_time: 3 ms", "end_time: 3 ms, engine: {law: event, budget: 3}")
    write_experiments(tmp_path, SLOW + short)
    invert(tmp_path, "experiments.yaml")
    rows = read_campaign(tmp_path / "experiments.h5").all_sample_rows()
    failed = rows[rows["fast.state"] == FAILED]
    assert len(failed)
    assert np.all(failed["state"] == FAILED)
    names = [name for name in rows.dtype.names if name.startswith("fast.class_")]
    assert names
    assert not any(failed[name].any() for name in names)


def test_a_run_that_stopped_goes_on_with_the_same_decisions(tmp_path, path):
    write_experiments(tmp_path)
    finish(tmp_path, "experiments.yaml", "--generations", "1")
    finish(tmp_path, "experiments.yaml")
    assert_same(tmp_path / "experiments.h5", decisions(path))
    (tmp_path / "sieve.csv").unlink()
    assert_sound(tmp_path / "experiments.h5")


@pytest.mark.ranks
def test_ranks_decide_as_one_process_does(tmp_path, path):
    need_mpirun()
    write_experiments(tmp_path)
    finish(tmp_path, "experiments.yaml", ranks=2)
    assert_same(tmp_path / "experiments.h5", decisions(path))


def test_tables_have_the_columns_of_each_experiment(path):
    samples = open_campaign(path).samples
    assert {"slow.particles", "fast.particles", "faster.particles"} <= set(samples)
    assert samples.attrs["units"]["fast.end_time"] == "s"
    assert not [name for name in samples if name.endswith("class_counts")]
