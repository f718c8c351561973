import json
import math

import numpy as np
import pytest
from campaign_runs import QUICKSTART, TINY, write_campaign

from agglom_mpi.planning import message_costs
from agglom_mpi.planning.forecast import FREE
from agglom_mpi.storage.reader import read_campaign

SCENE = QUICKSTART.parent / "extremes" / "at_rest.yaml"


def table_begins(lines):
    """Return the place of the table's heading; a busy machine has a line more above it."""
    return next(place for place, line in enumerate(lines) if line.startswith("ranks"))


def test_a_plan_says_how_long_it_would_take_and_what_that_rests_on(agglom):
    done = agglom("plan", QUICKSTART, "--seconds", "1", "--generations", "2", "--ranks", "1,10,100")
    assert done.exit_code == 0
    assert done.stderr == ""
    lines = done.stdout.splitlines()
    assert lines[0].startswith("Quickstart - double the mean grain size: at most 2 generations, 20")
    assert "samples of" in lines[1]
    assert "mean" in lines[1]
    first = table_begins(lines)
    table = [line.split()[0] for line in lines[first : first + 4]]
    assert table == ["ranks", "1", "10", "100"]


def test_json_holds_the_forecasts_from_a_campaign_file(agglom):
    done = agglom("plan", "tiny.yaml", "--from", "tiny.h5", "--ranks", "1, 4", "--json")
    plan = json.loads(done.stdout)
    assert plan["samples"]["source"] == "tiny.h5"
    assert plan["not_forecast"] == []
    rows = read_campaign("tiny.h5").all_sample_rows()
    times = [rows["cpu_seconds"][rows["string"] == i].mean() for i in np.unique(rows["string"])]
    expected = np.std(times, ddof=1) / math.sqrt(len(times)) / np.mean(times)
    assert plan["samples"]["relative_error"] == pytest.approx(expected)
    one, four = plan["forecasts"]
    assert (one["ranks"], four["ranks"]) == (1, 4)
    assert one["used"] == four["used"] > 0
    assert one["bound"] <= one["seconds"]
    assert one["reached"] == pytest.approx(one["bound"] / one["seconds"])
    assert min(plan["costs"].values()) >= 0.0
    assert plan["costs"]["message"] > 0.0


def test_a_plan_says_what_the_fresh_samples_of_the_best_take(agglom, tmp_path):
    path = write_campaign(tmp_path / "again.yaml", **TINY, final="{strings: 2, samples: 30}")
    words = ("plan", path, "--from", "tiny.h5", "--ranks", "1,4")
    one, four = json.loads(agglom(*words, "--json").stdout)["forecasts"]
    mean = read_campaign("tiny.h5").all_sample_rows()["cpu_seconds"]
    assert 60 * mean.min() <= one["again"] <= 60 * mean.max()
    assert one["again"] / 4 <= four["again"] <= one["again"] / 4 + mean.max()
    done = agglom(*words).stdout.splitlines()
    first = table_begins(done)
    assert done[first].endswith("+ fresh")
    assert any(line.startswith("fresh: at the end") for line in done)
    assert one["core_hours"] == pytest.approx((one["seconds"] + one["again"]) / 3600.0)
    assert len(max(done[first:-1], key=len)) < 80
    bare = agglom("plan", "tiny.yaml", "--from", "tiny.h5", "--ranks", "1").stdout
    assert "fresh" not in bare


def test_a_plan_ends_with_the_command_that_submits_it(agglom, monkeypatch):
    monkeypatch.setattr(message_costs, "measured_costs", lambda *_: FREE)
    words = ("plan", "tiny.yaml", "--from", "tiny.h5", "--ranks", "1,4")
    advice = json.loads(agglom(*words, "--json").stdout)["advice"]
    last = agglom(*words).stdout.splitlines()[-1].split()
    assert last[-2:] == ["slurm/campaign.sbatch", "tiny.yaml"]
    assert last[:2] == ["sbatch", f"--ntasks={advice['ranks']}"]
    minutes, hours = last[2].removeprefix("--time=").split(":")[1::-1]
    assert 3600 * int(hours) + 60 * int(minutes) == advice["walltime"]


def test_a_long_campaign_is_simulated_in_part_which_its_table_says(agglom, monkeypatch):
    from agglom_mpi.planning import plan

    monkeypatch.setattr(plan, "FORECAST_SAMPLES", 30)
    monkeypatch.setattr(message_costs, "measured_costs", lambda *_: FREE)
    words = ("plan", "tiny.yaml", "--from", "tiny.h5", "--ranks", "1,4")
    one, four = json.loads(agglom(*words, "--json").stdout)["forecasts"]
    assert 0.0 < one["share"] < 1.0
    assert one["used"] == pytest.approx(four["used"], abs=2.0)
    assert any(line.startswith("simulated: ") for line in agglom(*words).stdout.splitlines())


@pytest.mark.parametrize("ranks", ["", "0", "1,,2", "ten", "1.5", "-1", "1;2", "2000000"])
def test_what_is_no_list_of_ranks_is_said_in_one_message(agglom, ranks):
    done = agglom("plan", "tiny.yaml", "--ranks", ranks)
    assert done.exit_code == 2
    assert f"{ranks!r}" in done.stderr
    assert "allowed: numbers from 1 to" in done.stderr


def test_a_forecast_that_would_take_too_long_is_refused_and_the_others_shown(agglom, monkeypatch):
    from agglom_mpi.planning import cluster_simulator as virtual

    monkeypatch.setattr(virtual, "MAX_SIMULATED", 3)
    words = ("plan", "tiny.yaml", "--from", "tiny.h5", "--ranks", "1,2")
    refused = json.loads(agglom(*words, "--json").stdout)
    assert (refused["not_forecast"], refused["forecasts"]) == ([1, 2], [])
    done = agglom(*words)
    assert done.exit_code == 1
    assert "no forecast for 1, 2 ranks: more than 2000000 samples" in done.stdout
    assert "saturated" not in done.stdout


def test_mistakes_are_said_in_one_line(mistaken):
    assert "variables: has no range; a search needs" in mistaken("plan", SCENE)
    assert mistaken("plan", "nothing.yaml") == "nothing.yaml: no such file"
    assert mistaken("plan", "tiny.yaml", "--from", "no.h5") == "no.h5: No such file or directory"
    assert "tiny.yaml: not an HDF5 file" in mistaken("plan", "tiny.yaml", "--from", "tiny.yaml")
