"""`agglom export --paraview`: the particles of chosen samples, as they were."""

import os
import re
import subprocess

import numpy as np
import pytest
from campaign_runs import TINY, environment, finish
from particle_runs import COUNT, STRINGS, write_bulk_campaign
from processes import HANG
from vtk_files import assert_shows, read_vtkhdf

from agglom_mpi import load_campaign, open_campaign
from agglom_mpi.config.yaml_source import CampaignError
from agglom_mpi.outcome import COMPLETED
from agglom_mpi.report import paraview as module
from agglom_mpi.storage.reader import read_campaign
from agglom_mpi.variables import TEN
from agglom_mpi.verbs.simulate import simulate


@pytest.fixture(scope="module")
def pictured(tmp_path_factory):
    """Return the file of a tiny campaign with pictures of some samples of its best strings."""
    folder = tmp_path_factory.mktemp("pictured")
    write_bulk_campaign(folder / "bulk.yaml", **TINY)
    finish(folder, "bulk.yaml")
    return folder / "bulk.h5"


def simulated(string, sample, frames):
    """Return the frames of a sample of the tiny campaign."""
    row = read_campaign("tiny.h5").string_rows()[string]
    parameters = np.array([row[name] for name in TEN.names])
    return simulate(load_campaign("tiny.yaml"), parameters, sample, frames=frames).frames


def best(path="tiny.h5"):
    """Return the number of the best string."""
    return int(open_campaign(path).best(1)["string"][0])


def test_a_sample_without_pictures_is_simulated_again_exactly(agglom, tmp_path):
    done = agglom("export", "tiny.h5", "--paraview", tmp_path / "out.vtkhdf")
    assert done.exit_code == 0, done.stderr
    size = f"{(tmp_path / 'out.vtkhdf').stat().st_size / 1e6:.3g} MB"
    frames = simulated(best(), 0, 101)
    assert done.stdout == (
        f"{tmp_path}/out.vtkhdf: string {best()}, sample 0, 101 pictures to "
        f"{frames.times[-1]:.3g} s, simulated again, identical to the recorded sample, {size}\n"
    )
    assert_shows(tmp_path / "out.vtkhdf", frames)
    _, seen = read_vtkhdf(tmp_path / "out.vtkhdf")
    counts = [len(arrays["points"]) for arrays in seen]
    assert counts[0] == 100 > counts[-1]
    row = read_campaign("tiny.h5").sample_rows(best())[0]
    assert counts[-1] == row["particles"]
    mean = np.mean(seen[-1]["radius"]) / seen[0]["radius"][0]
    assert mean == pytest.approx(row["mean_radius_ratio"], rel=1e-13)
    assert {int(arrays["grains"].sum()) for arrays in seen} == {100}


def test_pictures_that_are_stored_are_shown_one_file_for_each_sample(agglom, pictured, tmp_path):
    done = agglom("export", pictured, "--paraview", tmp_path / "out.vtkhdf")
    assert done.exit_code == 0, done.stderr
    string = best(pictured)
    names = [f"out_{string}_0.vtkhdf", f"out_{string}_1.vtkhdf"]
    assert sorted(os.listdir(tmp_path)) == names
    assert len(re.findall(rf", {COUNT} pictures to \S+ s, as stored, ", done.stdout)) == 2
    for sample, name in enumerate(names):
        assert_shows(tmp_path / name, open_campaign(pictured).frames(string, sample))


def test_samples_can_be_chosen_and_come_each_once(agglom, tmp_path):
    words = ["--string", 2, "--sample", 3, "--sample", 1, "--sample", 3, "--frames", 4]
    done = agglom("export", "tiny.h5", "--paraview", tmp_path / "out.vtkhdf", *words)
    assert done.exit_code == 0, done.stderr
    assert sorted(os.listdir(tmp_path)) == ["out_2_1.vtkhdf", "out_2_3.vtkhdf"]
    for sample in (1, 3):
        assert_shows(tmp_path / f"out_2_{sample}.vtkhdf", simulated(2, sample, 4))


def test_more_pictures_than_are_stored_are_simulated(agglom, pictured, tmp_path):
    words = ["--paraview", tmp_path / "out.vtkhdf", "--sample", 1, "--frames", 2 * COUNT - 1]
    done = agglom("export", pictured, *words)
    assert done.exit_code == 0, done.stderr
    times, seen = read_vtkhdf(tmp_path / "out.vtkhdf")
    stored = open_campaign(pictured).frames(best(pictured), 1)
    assert times[::2] == pytest.approx(stored.times.tolist(), rel=1e-15)
    for f in (0, -1):
        assert seen[f]["points"].tobytes() == stored.positions[f, : stored.particles[f]].tobytes()


def test_a_string_without_pictures_is_simulated_though_others_have_some(agglom, pictured, tmp_path):
    strings = open_campaign(pictured).best(STRINGS + 1)["string"]
    words = ["--paraview", tmp_path / "out.vtkhdf", "--string", strings[STRINGS], "--frames", 2]
    done = agglom("export", pictured, *words)
    assert "simulated again, identical" in done.stdout
    assert os.listdir(tmp_path) == ["out.vtkhdf"]


def test_a_sample_that_comes_out_otherwise_is_told(agglom, tmp_path, monkeypatch):
    monkeypatch.setattr(module, "is_same", lambda stored, computed, version: False)
    words = ["--paraview", tmp_path / "out.vtkhdf", "--frames", 2]
    assert (
        "simulated again, differs from the recorded" in agglom("export", "tiny.h5", *words).stdout
    )


def test_the_first_sample_that_was_completed_is_shown(tiny_folder, monkeypatch, tmp_path):
    file = read_campaign(tiny_folder / "tiny.h5")
    rows = file.sample_rows(1).copy()
    rows["state"][:2] = COMPLETED + 1
    monkeypatch.setattr(file, "sample_rows", lambda string: rows)
    selection = module.FrameSelection(tmp_path / "out.vtkhdf", 1)
    [shown] = module.select_samples(file, selection)
    assert shown[:2] == (1, 2)
    rows["state"] = COMPLETED + 1
    with pytest.raises(CampaignError, match="--string: is 1, of which no sample was completed"):
        module.select_samples(file, selection)


def test_before_a_string_is_judged_none_is_the_best(tiny_folder, monkeypatch, tmp_path):
    file = read_campaign(tiny_folder / "tiny.h5")
    none = file.result_rows()[:0]
    monkeypatch.setattr(file, "result_rows", lambda: none)
    with pytest.raises(CampaignError, match="--string: is missing, and none is judged yet"):
        module.select_samples(file, module.FrameSelection(tmp_path / "out.vtkhdf"))


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["--string", 4], "tiny.h5: --string: is 4; allowed: 0 to 3"),
        (["--sample", 9], "which string {best} does not have; recorded: 0 to 4"),
    ],
)
def test_what_is_not_recorded_cannot_be_shown(mistaken, tmp_path, words, message):
    said = mistaken("export", "tiny.h5", "--paraview", tmp_path / "out.vtkhdf", *words)
    assert said.endswith(message.format(best=best()))
    assert os.listdir(tmp_path) == []


def test_a_sample_that_fails_cannot_be_shown(mistaken, tmp_path, monkeypatch):
    def fail(*arguments, **options):
        raise RuntimeError("sample 0 failed: non-finite state")

    monkeypatch.setattr("agglom_mpi.verbs.simulate.simulate", fail)
    said = mistaken("export", "tiny.h5", "--paraview", tmp_path / "out.vtkhdf")
    assert said == "tiny.h5: --sample: cannot be shown: sample 0 failed: non-finite state"
    assert os.listdir(tmp_path) == []


def test_the_name_must_be_one_that_paraview_knows(mistaken, tmp_path):
    said = mistaken("export", "tiny.h5", "--paraview", tmp_path / "out.h5")
    assert said == f"{tmp_path}/out.h5: --paraview: must end in .vtkhdf, by which ParaView knows it"


def test_nothing_is_overwritten_nor_written_before_that_is_known(mistaken, pictured, tmp_path):
    (tmp_path / f"out_{best(pictured)}_1.vtkhdf").write_text("precious")
    words = ["--paraview", tmp_path / "out.vtkhdf", "--compact", tmp_path / "copy.h5"]
    said = mistaken("export", pictured, *words)
    assert said.endswith("_1.vtkhdf: exists already and is not overwritten")
    [name] = os.listdir(tmp_path)
    assert (tmp_path / name).read_text() == "precious"


@pytest.mark.parametrize("words", [["--string", 1], ["--sample", 1], ["--frames", 5]])
def test_what_paraview_is_to_show_is_for_paraview(agglom, tmp_path, words):
    done = agglom("export", "tiny.h5", "--csv", tmp_path, *words)
    assert done.exit_code == 2
    assert done.stderr.endswith(f"Error: {words[0]} is for --paraview\n")
    assert os.listdir(tmp_path) == []


@pytest.mark.slow
def test_a_full_disc_is_one_message(pictured, tmp_path):
    words = ["agglom", "export", str(pictured), "--paraview", str(tmp_path / "out.vtkhdf")]
    done = subprocess.run(
        ["bash", "-c", f"ulimit -f 8; exec {' '.join(words)} --sample 0"],
        env=environment(),
        capture_output=True,
        text=True,
        timeout=HANG,
        check=False,
    )
    assert (done.returncode, done.stderr) == (2, f"{tmp_path}/out.vtkhdf: File too large\n")
    assert os.listdir(tmp_path) == []
