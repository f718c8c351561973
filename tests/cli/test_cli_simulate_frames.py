"""`agglom simulate --frames --out`: the pictures of one run."""

import importlib.util
import json
import os
from xml.etree import ElementTree

import numpy as np
import pytest
from matplotlib import image
from vtk_files import assert_shows

from agglom_mpi import load_campaign
from agglom_mpi.report import simulate as module
from agglom_mpi.storage.reader import read_campaign
from agglom_mpi.variables import TEN
from agglom_mpi.verbs.simulate import simulate

NAMES = ["cloud.png", "cloud.svg", "evolution.png", "evolution.svg", "particles.vtkhdf"]


def assert_pictures(folder, panels):
    """Check that the pictures are there, whole, and not empty."""
    assert sorted(os.listdir(folder)) == NAMES
    for name in ("cloud", "evolution"):
        pixels = image.imread(folder / f"{name}.png")[..., :3]
        assert min(pixels.shape[:2]) > 300
        assert 0.01 < np.mean(np.any(pixels < 0.9, axis=2)) < 0.9
        svg = ElementTree.parse(folder / f"{name}.svg").getroot()
        axes = [each for each in svg.iter() if each.get("id", "").startswith("axes_")]
        assert len(axes) == (panels + 1 if name == "cloud" else 4)


def test_a_run_of_a_campaign_is_shown(agglom, tmp_path):
    words = ["--set", "hardness=67 MPa", "--frames", 4, "--out", tmp_path / "run"]
    done = agglom("simulate", "tiny.yaml", *words)
    assert done.exit_code == 0, done.stderr
    assert "result of 1 sample, without a standard error" in done.stdout
    assert done.stdout.splitlines()[-5:] == [f"{tmp_path}/run/{name}" for name in NAMES]
    assert_pictures(tmp_path / "run", 4)
    frames = simulate(load_campaign("tiny.yaml"), {"hardness": 67e6}, 0, frames=4).frames
    assert_shows(tmp_path / "run" / "particles.vtkhdf", frames)


def test_a_recorded_sample_is_shown_and_is_the_one_that_was_recorded(agglom, tmp_path):
    words = ["--string", 2, "--sample", 3, "--frames", 12, "--out", tmp_path, "--json"]
    done = agglom("simulate", "tiny.h5", *words)
    assert done.exit_code == 0, done.stderr
    report = json.loads(done.stdout)
    assert report["replay"] == "identical to the recorded sample"
    assert report["files"] == [f"{tmp_path}/{name}" for name in NAMES]
    assert_pictures(tmp_path, 9)
    row = read_campaign("tiny.h5").string_rows()[2]
    parameters = np.array([row[name] for name in TEN.names])
    frames = simulate(load_campaign("tiny.yaml"), parameters, 3, frames=12).frames
    assert_shows(tmp_path / "particles.vtkhdf", frames)


def test_a_recorded_string_is_shown_by_its_first_sample(agglom, tmp_path):
    words = ["--string", 1, "--frames", 2, "--out", tmp_path, "--json"]
    report = json.loads(agglom("simulate", "tiny.h5", *words).stdout)
    assert report["samples"] == 1
    assert report["replay"] == "identical to the recorded sample"
    mean = read_campaign("tiny.h5").sample_rows(1)[0]["mean_radius_ratio"]
    assert report["measured"]["mean_radius_ratio"]["mean"] == mean


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["--frames", 3], "--frames F and --out DIR belong together"),
        (["--out", "run"], "--frames F and --out DIR belong together"),
        (["--frames", 3, "--out", "run", "--samples", 5], "choose it with --sample, not --samples"),
        (["--frames", 1, "--out", "run"], "1 is not in the range 2<=x<=100000"),
    ],
)
def test_what_does_not_go_together_is_said(agglom, tiny_folder, words, message):
    done = agglom("simulate", "tiny.yaml", *words)
    assert done.exit_code == 2
    assert done.stderr.rstrip().rstrip(".").endswith(message)
    assert not (tiny_folder / "run").exists()


def never(*arguments, **options):
    raise AssertionError("simulated")


def test_nothing_is_overwritten_and_that_is_known_at_once(mistaken, tmp_path, monkeypatch):
    monkeypatch.setattr(module, "simulate", never)
    (tmp_path / "cloud.svg").write_text("precious")
    words = ["simulate", "tiny.yaml", "--frames", 3, "--out"]
    said = mistaken(*words, tmp_path)
    assert said == f"{tmp_path}/cloud.svg: exists already and is not overwritten"
    assert os.listdir(tmp_path) == ["cloud.svg"]
    said = mistaken(*words, tmp_path / "cloud.svg")
    assert said == f"{tmp_path}/cloud.svg: is no directory"


def test_without_matplotlib_it_says_what_to_install(mistaken, tmp_path, monkeypatch):
    find = importlib.util.find_spec
    without = lambda name, *rest: None if name == "matplotlib" else find(name, *rest)  # noqa: E731
    monkeypatch.setattr(importlib.util, "find_spec", without)
    monkeypatch.setattr(module, "simulate", never)
    said = mistaken("simulate", "tiny.yaml", "--frames", 3, "--out", tmp_path / "run")
    assert said == "pictures need matplotlib: pip install 'agglom_mpi[report]'"
    assert os.listdir(tmp_path) == []


def test_of_a_sample_that_fails_there_is_no_picture(agglom, tmp_path, monkeypatch):
    def fail(*arguments):
        raise RuntimeError("sample 0 failed: non-finite state")

    monkeypatch.setattr(module, "simulate", fail)
    done = agglom("simulate", "tiny.yaml", "--frames", 3, "--out", tmp_path / "run")
    assert (done.exit_code, done.stdout) == (1, "sample 0 failed: non-finite state\n")
    assert os.listdir(tmp_path) == []
