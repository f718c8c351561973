"""Campaigns whose grains have sizes from a file: run, resumed, verified, replayed, reported."""

import json

import h5py
import numpy as np
import pytest
from campaign_runs import SMALL, assert_sound, finish, invert, write_campaign
from click.testing import CliRunner

from agglom_mpi.analysis.quantity_means import drawn_fraction
from agglom_mpi.analysis.ranking import rank_strings
from agglom_mpi.analysis.run_warnings import run_warnings
from agglom_mpi.analysis.summary import collect_summary
from agglom_mpi.campaign_file import open_campaign
from agglom_mpi.cli import main
from agglom_mpi.config.loading import load_campaign
from agglom_mpi.outcome import FailureReason
from agglom_mpi.storage.reader import read_campaign
from agglom_mpi.storage.recorded_campaign import recorded_campaign
from agglom_mpi.variables import TEN
from agglom_mpi.verbs.estimate import estimate
from agglom_mpi.verbs.simulate import simulate

pytestmark = pytest.mark.slow(guard="measurements/test_curve_file.py")


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    """Return a folder with a campaign of listed sizes, and its file without the list."""
    folder = tmp_path_factory.mktemp("sizes")
    path = write_campaign(folder / "sizes.yaml", **SMALL, final="{strings: 2, samples: 4}")
    line = "half_width: 1 cm"
    text = path.read_text()
    assert text.count(line) == 1
    path.write_text(text.replace(line, f"{line}\n  sizes: {{file: list.csv}}"))
    (folder / "list.csv").write_text("\n".join(map(str, np.linspace(1.0, 2.0, 50))))
    finish(folder, "sizes.yaml", "-q")
    campaign = load_campaign(path)
    (folder / "list.csv").write_text("1\n2\n")
    return folder, campaign


def test_a_file_does_not_need_the_list_any_more(run, tmp_path):
    folder, campaign = run
    path = folder / "sizes.h5"
    assert_sound(path)
    file = open_campaign(path)
    row = file.samples.iloc[-1]
    words = ["simulate", str(path), "--string", str(row["string"]), "--sample", str(row["sample"])]
    assert "identical to the recorded sample" in CliRunner().invoke(main, words).stdout
    done = CliRunner().invoke(main, ["report", str(path), "--out", str(tmp_path / "report")])
    assert done.exit_code == 0, done.output
    assert "sizes: drawn from the 50 rows of list.csv" in (
        (tmp_path / "report/report.html").read_text()
    )
    with h5py.File(path) as stored:
        assert json.loads(stored.attrs["identity"]) == campaign.identity()


def test_other_sizes_are_another_campaign(run):
    folder, _ = run
    done = invert(folder, "sizes.yaml")
    assert done.returncode == 2
    assert "belongs to another campaign" in done.stderr
    assert "scene.sizes.diameters: 1.0 1.0204081632653061" in done.stderr
    assert " ... " in done.stderr
    assert "2.0 in the file, 1.0 2.0 now" in done.stderr


def test_all_grains_are_in_the_particles_that_are_left(run):
    _, campaign = run
    final = simulate(campaign, {}).final
    assert final.grains.sum() == campaign.scene.particles


def test_the_report_states_what_the_drawn_grains_of_completed_samples_fill(run):
    file = read_campaign(run[0] / "sizes.h5")
    campaign, string = recorded_campaign(file), int(rank_strings(file).order[0])
    rows = file.all_sample_rows()
    rows = rows[(rows["string"] == string) & (rows["state"] == 1)]
    parameters = file.parameters[string]
    scene = campaign.scene.build(parameters)
    filled = [
        simulate(campaign, parameters, int(sample)).final.masses.sum()
        / (scene.mass / (4.0 / 3.0 * np.pi * scene.radius**3) * (2.0 * scene.half_width) ** 3)
        for sample in rows["sample"]
    ]
    drawn = drawn_fraction(file, string)
    assert drawn.completed.value == pytest.approx(np.mean(filled), rel=1e-12)
    assert drawn.completed.samples == len(rows)
    best = collect_summary(file)["best"][0]
    assert best["drawn_volume_fraction"] == drawn.as_dict()
    size_ratio = file.parameters[string][TEN.names.index("size_ratio")]
    assert drawn.wanted == pytest.approx(campaign.variables.fraction(size_ratio), rel=1e-12)
    found = estimate(campaign, parameters, 3)
    assert found.volume_fraction.value == pytest.approx(np.mean(filled[:3]), rel=1e-12)


def test_jammed_samples_of_a_wide_law_are_warned_of(run, monkeypatch):
    file = read_campaign(run[0] / "sizes.h5")
    assert not any(line.startswith("scene.sizes") for line in run_warnings(file))
    rows = file.counted_samples.copy()
    rows["reason"][:2] = FailureReason.PLACEMENT_JAMMED
    monkeypatch.setattr(type(file), "counted_samples", property(lambda self: rows))
    [line] = [line for line in run_warnings(file) if line.startswith("scene.sizes")]
    assert line.startswith(f"scene.sizes: 2 of {len(rows)} samples found no place")
