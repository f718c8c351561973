"""Campaigns that search numbers of their scene: run, resumed, verified, replayed, reported."""

import json

import h5py
import numpy as np
import pytest
from campaign_runs import assert_same, assert_sound, decisions, finish, invert, stop_here
from click.testing import CliRunner
from once import made_once, shared_folder
from own_components import SPEED, write_scene
from path_campaigns import HOT, HOT_VARIABLES, SIZED, text_of

from agglom_mpi import Box
from agglom_mpi.campaign_file import open_campaign
from agglom_mpi.cli import main
from agglom_mpi.config.loading import load_campaign
from agglom_mpi.formatting import label_of
from agglom_mpi.outcome import FAILED
from agglom_mpi.storage.reader import read_campaign
from agglom_mpi.storage.schema import FORMAT_VERSION
from agglom_mpi.variables import PAPER_VARIABLES
from agglom_mpi.verbs.simulate import simulate

NAMES = ("end_time", "sizes.spread", "volume_fraction")

HOT_CAMPAIGN = text_of(
    HOT | {"end_time": None},
    HOT_VARIABLES
    | {"end_time": "[1 ms, 2 ms]", "duration.length_ratio": "[0.2, 1, log]"}
    | {"contact_area.initial": "0.05"},
    more="final: none\n",
).replace("generations: 3", "generations: 1")


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    """Return the folder of a campaign and its file, which tests only read."""

    def make(folder):
        (folder / "sized.yaml").write_text(SIZED)
        finish(folder, "sized.yaml", "-q")

    return made_once(shared_folder(tmp_path_factory) / "paths", make)


def command(*words, code=0):
    done = CliRunner().invoke(main, list(map(str, words)))
    assert done.exit_code == code, done.output
    return done


def test_a_file_has_a_column_and_a_row_for_each_variable(run):
    """Read by h5py alone."""
    assert_sound(run / "sized.h5")
    with h5py.File(run / "sized.h5") as file:
        assert file.attrs["format_version"] == FORMAT_VERSION
        rows, strings = file["variables"][:], file["strings"][:]
        names = [name.decode() for name in rows["name"]]
        assert names == [*(variable.name for variable in PAPER_VARIABLES), *NAMES]
        assert strings.dtype.names[5:-1] == tuple(names)
        done = file["strings_done"][:] == 1
        assert np.isnan(strings["size_ratio"][done]).all()
        for row in rows[len(PAPER_VARIABLES) :]:
            values = strings[row["name"].decode()][done]
            assert ((row["lower"] <= values) & (values <= row["upper"])).all()
            assert row["searched"] == (row["lower"] < row["upper"])
        assert (strings["sizes.spread"][done] > 1.12).all()
        units = dict(zip(strings.dtype.names, file["strings"].attrs["field_units"], strict=True))
        assert units["end_time"] == "s"
        entries = json.loads(file.attrs["identity"])
        assert entries["variables.sizes.spread.0"] == 1.1
        assert "scene.sizes.spread" not in entries
        assert entries == load_campaign(run / "sized.yaml").identity()


def test_stopped_and_resumed_it_is_the_same(run, tmp_path):
    (tmp_path / "sized.yaml").write_text(SIZED)
    stop_here(tmp_path, "sized")
    assert_sound(tmp_path / "sized.h5")
    finish(tmp_path, "sized.yaml", "-q")
    assert_same(tmp_path / "sized.h5", decisions(run / "sized.h5"))


def test_a_file_with_another_range_belongs_to_another_campaign(run, tmp_path):
    text = SIZED.replace("sizes.spread: [1.1, 1.3]", "sizes.spread: [1.1, 1.25]")
    (tmp_path / "sized.yaml").write_text(text)
    done = invert(tmp_path, "sized.yaml", "-o", run / "sized.h5")
    assert done.returncode == 2
    assert "variables.sizes.spread.1: 1.3 in the file, 1.25 now" in done.stderr


def test_a_recorded_sample_is_simulated_again_bit_for_bit(run):
    row = open_campaign(run / "sized.h5").samples.iloc[-1]
    words = ["--string", row["string"], "--sample", row["sample"], "--json"]
    found = json.loads(command("simulate", run / "sized.h5", *words).stdout)
    assert found["replay"].startswith("identical")
    assert set(NAMES) <= found["parameters"].keys()


def test_tables_name_the_variables_as_the_campaign_does(run, tmp_path):
    file = open_campaign(run / "sized.h5")
    assert set(NAMES) <= set(file.strings.columns)
    assert "size_ratio" not in file.strings.columns
    assert file.strings.attrs["units"]["end_time"] == "s"
    variables = file.variables.set_index("name")
    assert variables.loc["sizes.spread", ["lower", "upper"]].tolist() == [1.1, 1.3]
    derived = file.strings["spread_less_one"]
    assert np.array_equal(derived, file.strings["sizes.spread"] - 1.0)
    again = file.best(1)
    assert {*NAMES} <= set(again.columns)
    campaign = load_campaign(run / "sized.yaml")
    string = campaign.parameters(dict(again.iloc[0]))
    assert string.tolist()[-len(NAMES) :] == again[[*NAMES]].iloc[0].tolist()
    command("export", run / "sized.h5", "--csv", tmp_path / "csv")
    head = (tmp_path / "csv/strings.csv").read_text().splitlines()[0].split(",")
    assert {"end_time (s)", "sizes.spread", "volume_fraction"} <= set(head)


def test_objectives_are_of_the_grains_of_each_string(run):
    """Π = |1 − b/b*| with b*/b⁰ = (N ⟨b³⟩/⟨b⟩³)^⅓ of the string's own law of sizes [B 7.1]."""
    data = read_campaign(run / "sized.h5")
    rows = data.searched_samples
    rows = rows[rows["state"] == 1]
    spread = data.values(rows["string"], "sizes.spread")
    most = (30.0 * np.exp(3.0 * np.log(spread) ** 2)) ** (1.0 / 3.0)
    assert rows["objective"] == pytest.approx(1.0 - rows["mean_radius_ratio"] / most, rel=1e-12)
    for result in data.result_rows():
        own = rows["objective"][rows["string"] == result["string"]]
        assert result["objective"] == pytest.approx(own.mean(), rel=1e-12)


def test_reports_have_the_variables(run):
    said = command("report", run / "sized.h5").stdout
    best = json.loads(command("report", run / "sized.h5", "--json").stdout)
    for name in NAMES:
        assert label_of(name) in said
        assert name in best["best"][0]
    assert best["further"] == {"end_time": "s", "sizes.spread": "1", "volume_fraction": "1"}


@pytest.mark.slow(guard="runtime/test_path_runs.py::test_reports_have_the_variables")
def test_a_page_has_the_variables(run, tmp_path):
    command("report", run / "sized.h5", "--out", tmp_path / "page")
    page = (tmp_path / "page/report.html").read_text()
    assert all(name in page for name in NAMES if name != "volume_fraction")


def test_a_comparison_states_what_differs_with_units(run, tmp_path):
    text = HOT_CAMPAIGN.replace("end_time: [1 ms, 2 ms]", "end_time: [1 ms, 3 ms]")
    for name, written in (("one", HOT_CAMPAIGN), ("other", text)):
        (tmp_path / f"{name}.yaml").write_text(written)
        finish(tmp_path, f"{name}.yaml", "-q")
    said = command("report", tmp_path / "one.h5", tmp_path / "other.h5").stdout
    assert "variables.end_time.1: 0.002, 0.003 s" in said


def test_a_compact_copy_and_another_start_have_the_variables(run, tmp_path):
    compact = tmp_path / "compact.h5"
    command("export", run / "sized.h5", "--compact", compact)
    assert_sound(compact)
    assert read_campaign(compact).variables == read_campaign(run / "sized.h5").variables
    start = (
        f"search: {{population: 8, parents: 4, start: {{file: {run / 'sized.h5'}, strings: 2}}}}"
    )
    text = SIZED.replace("search: {population: 8, parents: 4}", start)
    (tmp_path / "warm.yaml").write_text(text.replace("generations: 3", "generations: 1"))
    finish(tmp_path, "warm.yaml", "-q")
    first = open_campaign(tmp_path / "warm.h5").strings.iloc[0]
    best = open_campaign(run / "sized.h5").best(1).iloc[0]
    assert first[[*NAMES]].tolist() == best[[*NAMES]].tolist()


def test_a_box_takes_values_by_path(run):
    """It starts as the sample does, and its grains have the sizes that the spread gives."""
    path = run / "sized.yaml"
    campaign = load_campaign(path)
    values = {"sizes.spread": 1.25, "volume_fraction": 0.1}
    box = Box(path, values, sample=2)
    outcome = simulate(campaign, values, 2, frames=[0.0])
    assert np.array_equal(np.sort(box.particles.radii), np.sort(outcome.frames.radii[0]))
    narrow = Box(path, values | {"sizes.spread": 1.13}, sample=2)
    assert np.std(narrow.particles.radii) < np.std(box.particles.radii)


def test_values_on_the_command_line_take_paths(run):
    words = ["simulate", run / "sized.yaml", "--samples", 2, "--json"]
    values = ["--set", "sizes.spread=1.2", "--set", "end_time=1.5e-3"]
    found = json.loads(command(*words, *values).stdout)
    assert found["parameters"]["sizes.spread"] == 1.2
    assert found["parameters"]["end_time"] == 1.5e-3
    wrong = command(*words, "--set", "sizes.spread=0.5", code=2)
    assert "sizes.spread" in wrong.output


@pytest.mark.slow
def test_numbers_of_an_own_law_are_searched_and_its_file_is_read_without_code(tmp_path):
    numbers = "restitution.sticking: [1 cm/s, 1 m/s, log], restitution.speed: 3 m/s, "
    edits = [(", speed: 3 m/s, sticking: 30 cm/s", ""), ("variables: {", f"variables: {{{numbers}")]
    path = write_scene(tmp_path, SPEED, *edits)
    finish(tmp_path, path.name, "-q", "--allow-code")
    path.unlink()
    (tmp_path / "sticking.py").unlink()
    assert_sound(tmp_path / "own.h5")
    file = open_campaign(tmp_path / "own.h5")
    sticking = file.strings["restitution.sticking"]
    assert ((sticking >= 0.01) & (sticking <= 1.0)).all()
    assert file.strings.attrs["units"]["restitution.sticking"] == "m/s"
    words = ["simulate", file.path, "--string", 1, "--sample", 0, "--json", "--allow-code"]
    assert json.loads(command(*words).stdout)["replay"].startswith("identical")


REFUSED = """\
seed: 1
scene:
  particles: 20
  sizes: {law: uniform}
  velocities: {law: spread, mean: [0, 0, 0], transverse: 1}
  restitution: {law: constant, value: 0.5}
  heating: none
  end_time: 0.01 ms
variables:
  sizes.smallest: [1 um, 2 um]
  sizes.largest: [1.6 um, 3 um]
  relative_speed: 1
  volume_fraction: 0.02
  density: 2500
objective: {law: growth_target, ratio: 1.01}
search: {method: sobol, population: 16}
ensemble: {rule: fixed, samples: 2}
stopping: {generations: 1}
final: none
"""


def test_samples_of_a_string_that_a_law_refuses_fail_and_the_campaign_goes_on(tmp_path):
    (tmp_path / "refused.yaml").write_text(REFUSED)
    finish(tmp_path, "refused.yaml", "-q")
    assert_sound(tmp_path / "refused.h5")
    file = read_campaign(tmp_path / "refused.h5")
    strings = np.arange(len(file.string_rows()))
    inverted = file.values(strings, "sizes.largest") < file.values(strings, "sizes.smallest")
    samples = file.all_sample_rows()
    failed = np.unique(samples["string"][samples["state"] == FAILED])
    assert failed.tolist() == strings[inverted].tolist() != []


def test_other_further_variables_than_in_the_text_are_a_fault(run, tmp_path):
    (tmp_path / "other.h5").write_bytes((run / "sized.h5").read_bytes())
    with h5py.File(tmp_path / "other.h5", "r+") as file:
        entries = json.loads(file.attrs["further_variables"])
        entries[0][2] = "another number"
        file.attrs["further_variables"] = json.dumps(entries)
    assert "further variables" in command("check", tmp_path / "other.h5", code=1).output
