"""`agglom pareto`: the front of three campaigns of one question under different constraints."""

import math

import numpy as np
import pytest
from campaign_runs import finish, write_campaign

from agglom_mpi import open_campaign
from agglom_mpi.formatting import value_with_error

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


def test_the_table_has_the_re_estimates_of_the_best_strings_in_units_of_the_file(pareto, folder):
    done = pareto("--x", "pressure")
    assert done.exit_code == 0, done.output
    lines = done.stdout.splitlines()
    for name, line in zip(LIMITS, lines[1:], strict=False):
        [best] = open_campaign(folder / f"{name}.h5").best(1).to_dict("records")
        shown = value_with_error(best["estimate"], best["estimate_standard_error"])
        assert line.split()[:2] == [f"{name}.h5", str(best["string"])]
        assert f" {shown} " in f"{line} "
    assert not lines[1].endswith("dominated")


def test_growth_has_the_error_of_its_fresh_samples(pareto, folder):
    words = ["--y", "mean_radius_ratio", "--maximise", "mean_radius_ratio"]
    done = pareto("--x", "pressure", *words)
    assert done.exit_code == 0, done.output
    line = done.stdout.splitlines()[1]
    samples = open_campaign(folder / "low.h5").samples
    own = samples[samples["fresh"] & (samples["string"] == int(line.split()[1]))]
    ratios = own["mean_radius_ratio"]
    assert value_with_error(ratios.mean(), np.std(ratios, ddof=1) / math.sqrt(len(own))) in line


def test_without_fresh_samples_the_table_says_so(pareto, folder, tiny_folder):
    done = pareto("--x", "relative_speed", files=[tiny_folder / "tiny.h5"])
    assert done.exit_code == 0, done.output
    assert "as searched" in done.stdout


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
        ([], "--x"),
    ],
)
def test_mistakes_are_one_message(pareto, words, named):
    done = pareto(*words)
    assert done.exit_code == 2
    assert named in done.stderr
    assert "Traceback" not in done.stderr
