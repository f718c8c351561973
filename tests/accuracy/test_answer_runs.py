"""Processor times of runs, and what their answers were, from their files."""

import json
from types import SimpleNamespace

import numpy as np
import pytest
from campaign_runs import finish, write_campaign

from agglom_mpi.accuracy.answer.runs import (
    AnswerRun,
    ProcessorClock,
    history_of,
    processor_seconds,
    until,
)
from agglom_mpi.config.answer_study import Setting
from agglom_mpi.config.campaign import Campaign
from agglom_mpi.config.yaml_source import parse
from agglom_mpi.storage.reader import read_campaign


def written(folder, *lines):
    path = folder / "run.seconds"
    path.write_text("".join(f"{line}\n" for line in lines))
    return path


def test_times_of_legs_add_up(tmp_path):
    path = written(tmp_path, "[0, 0, 1.0]", "[0, 1, 2.5]", "[1, 2, 0.5]", "[2, 3, 0.25]")
    assert processor_seconds(path, 4).tolist() == [1.0, 2.5, 3.0, 3.25]


def test_a_line_that_a_kill_has_cut_off_is_left_out(tmp_path):
    path = written(tmp_path, "[0, 0, 1.0]", "[0, 1, 2.", "[1, 2, 0.5]")
    assert processor_seconds(path, 3).tolist() == [1.0, 1.5, 1.5]


def test_a_generation_without_a_line_has_the_time_of_the_next_or_the_last(tmp_path):
    path = written(tmp_path, "[0, 1, 2.0]")
    assert processor_seconds(path, 3).tolist() == [2.0, 2.0, 2.0]


def test_without_any_line_the_time_is_unknown(tmp_path):
    assert np.isnan(processor_seconds(tmp_path / "no.seconds", 2)).all()


def test_a_clock_continues_the_file_as_another_leg(tmp_path):
    path = tmp_path / "run.seconds"
    for leg in range(2):
        clock = ProcessorClock(path)
        clock.begin("", "", 1, "", 0, None)
        sum(i * i for i in range(100_000))
        clock.generation(SimpleNamespace(generation=leg), 2, 1, 1.0)
    legs = [line.split(",")[0] for line in path.read_text().splitlines()]
    assert legs == ["[0", "[1"]
    first, second = processor_seconds(path, 2)
    assert 0.0 < first < second


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    folder = tmp_path_factory.mktemp("run")
    path = write_campaign(folder / "small.yaml", generations=3, max_samples=12)
    finish(folder, "small.yaml")
    text = json.dumps(parse(path.read_text(), path.name).data)  # as a study writes it
    campaign = Campaign.from_text(text, path.name)
    return AnswerRun(Setting("", "default", campaign), campaign.seed, folder / "small.h5")


def test_the_history_of_a_run_is_that_of_its_generations(run):
    file = read_campaign(run.path)
    run.clock_path.write_text("[0, 0, 1.0]\n[0, 1, 2.0]\n[0, 2, 3.0]\n")
    found, rows = history_of(run, file), file.generation_rows()
    assert found.samples.tolist() == rows["samples_used"].tolist()
    assert found.seconds.tolist() == [1.0, 2.0, 3.0]
    for string, claimed, row in zip(found.best, found.claimed, rows, strict=True):
        assert string.tobytes() == file.parameters[int(row["best_string"])].tobytes()
        assert claimed == row["best_objective"]


def test_a_file_until_a_generation_holds_the_samples_that_its_decisions_rest_on(run):
    file = read_campaign(run.path)
    for generation, row in enumerate(file.generation_rows()):
        earlier = until(file, generation)
        assert len(earlier.all_sample_rows()) == row["samples_used"]
        assert len(earlier.string_rows()) == row["evaluations"]
        assert earlier.string_rows()["generation"].max() == generation


def test_a_run_is_finished_only_as_the_same_campaign(run):
    assert run.is_finished(run.request(False))
    other = run._replace(seed=2)
    assert not other.is_finished(other.request(False))
    absent = run._replace(path=run.path.with_name("absent.h5"))
    assert not absent.is_finished(absent.request(False))
