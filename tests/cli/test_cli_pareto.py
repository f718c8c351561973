"""`agglom pareto`: the front of three campaigns of one question under different constraints."""

import math

import numpy as np
import pandas as pd
import pytest
from campaign_runs import finish, write_campaign

from agglom_mpi import open_campaign

LIMITS = {"low": 1e4, "middle": 3e5, "high": 4e6}
"""Largest pressure of each campaign, Pa."""


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    folder = tmp_path_factory.mktemp("front")
    for name, limit in LIMITS.items():
        path = folder / f"{name}.yaml"
        write_campaign(path, final="{strings: 2, samples: 8}", generations=2, max_samples=10)
        more = "derived: {pressure: density * relative_speed**2}\n"
        more += f"constraints: [pressure < {limit:g} Pa]\n"
        path.write_text(path.read_text().rstrip() + "\n" + more)
        finish(folder, path.name)
    return folder


@pytest.fixture
def pareto(folder, agglom, monkeypatch):
    """Return a function that compares the three, or other files."""

    def run(*words, files=("low.h5", "middle.h5", "high.h5")):
        monkeypatch.chdir(folder)
        return agglom("pareto", *files, *words)

    return run


def test_the_table_has_the_re_estimates_of_the_best_strings(pareto, folder, tmp_path):
    done = pareto("--x", "pressure", "--out", tmp_path / "front")
    assert done.exit_code == 0, done.output
    table = pd.read_csv(tmp_path / "front.csv")
    assert len(table) == 3
    for name, row in zip(LIMITS, table.to_dict("records"), strict=True):
        [best] = open_campaign(folder / f"{name}.h5").best(1).to_dict("records")
        assert row["string"] == best["string"]
        assert row["objective"] == best["estimate"]
        assert row["objective_standard_error"] == best["estimate_standard_error"]
        assert row["pressure (Pa)"] == best["pressure"] < LIMITS[name]
        assert row["pressure_standard_error (Pa)"] == 0.0
        assert row["fresh"]
    lowest = table["pressure (Pa)"].idxmin()
    assert table["verdict"][lowest] != "dominated"
    for kind in ("png", "svg"):
        assert (tmp_path / f"front.{kind}").stat().st_size > 5000


def test_growth_has_the_error_of_its_fresh_samples(pareto, folder, tmp_path):
    words = ["--y", "mean_radius_ratio", "--maximise", "mean_radius_ratio"]
    done = pareto("--x", "pressure", *words, "--out", tmp_path / "front")
    assert done.exit_code == 0, done.output
    row = pd.read_csv(tmp_path / "front.csv").iloc[0]
    samples = open_campaign(folder / "low.h5").samples
    own = samples[samples["fresh"] & (samples["string"] == row["string"])]["mean_radius_ratio"]
    assert row["mean_radius_ratio"] == pytest.approx(own.mean())
    error = np.std(own, ddof=1) / math.sqrt(len(own))
    assert row["mean_radius_ratio_standard_error"] == pytest.approx(error)


def test_without_fresh_samples_the_table_says_so(pareto, folder, tiny_folder, tmp_path):
    files = [tiny_folder / "tiny.h5"]
    done = pareto("--x", "relative_speed", "--out", tmp_path / "front", files=files)
    assert done.exit_code == 0, done.output
    assert "as searched" in done.stdout
    assert not pd.read_csv(tmp_path / "front.csv")["fresh"].any()


def test_objectives_of_other_questions_are_warned_of(pareto, folder):
    other = folder / "other.yaml"
    text = (folder / "low.yaml").read_text()
    assert "ratio: 2" in text
    other.write_text(text.replace("ratio: 2", "ratio: 1.5"))
    finish(folder, "other.yaml")
    done = pareto("--x", "pressure", files=("low.h5", "other.h5"))
    assert done.exit_code == 0
    assert done.stderr.count("\n") == 1


@pytest.mark.parametrize(
    ("words", "named"),
    [
        (["--x", "presure"], "'pressure'"),
        (["--x", "objective"], "--y"),
        (["--x", "pressure", "--maximise", "hardness"], "hardness"),
        (["--x", "temperature_of_all"], "temperature"),
        (["--x", "pressure", "--out", ""], "name"),
        ([], "--x"),
    ],
)
def test_mistakes_are_one_message(pareto, words, named):
    done = pareto(*words)
    assert done.exit_code == 2
    assert named in done.stderr
    assert "Traceback" not in done.stderr


def test_existing_files_are_kept(pareto, tmp_path):
    (tmp_path / "front.png").write_text("mine")
    done = pareto("--x", "pressure", "--out", tmp_path / "front")
    assert done.exit_code == 2
    assert (tmp_path / "front.png").read_text() == "mine"
    assert not (tmp_path / "front.csv").exists()
