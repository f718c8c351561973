import json
import re
from pathlib import Path

import h5py
import pytest
from campaign_runs import QUICKSTART, SMALL, write_campaign
from path_campaigns import COLD, COLD_VARIABLES, text_of

from agglom_mpi import load_campaign
from agglom_mpi.analysis import resimulation
from agglom_mpi.outcome import COLUMNS
from agglom_mpi.report import simulate as module
from agglom_mpi.storage.reader import read_campaign
from agglom_mpi.storage.schema import FORMAT_VERSION
from agglom_mpi.variables import TEN
from agglom_mpi.verbs.estimate import estimate as estimated
from agglom_mpi.verbs.simulate import changes_until, simulate


def test_a_string_is_averaged_over_samples(agglom):
    done = agglom("simulate", "tiny.yaml", "--set", "hardness=67 MPa", "--samples", 4, "--json")
    assert done.exit_code == 0
    report = json.loads(done.stdout)
    campaign = load_campaign("tiny.yaml")
    outcomes = [simulate(campaign, {"hardness": 67e6}, sample) for sample in range(4)]
    mean = sum(outcome.mean_radius_ratio for outcome in outcomes) / 4
    assert report["samples"] == 4
    assert report["measured"]["mean_radius_ratio"]["mean"] == pytest.approx(mean, rel=1e-14)
    assert report["objective"]["mean"] == pytest.approx(abs(mean / 2 - 1), rel=1e-12)
    assert report["parameters"]["hardness"] == 67e6
    assert report["parameters"]["relative_speed"] == 15.05  # the middle of its range
    assert "surface_energy" not in report["parameters"]
    assert set(report["ledger"]) >= {"momentum_error", "energy_error", "overlaps"}


def test_one_sample_has_no_standard_error(agglom):
    report = json.loads(agglom("simulate", "tiny.yaml", "--samples", 1, "--json").stdout)
    assert report["objective"]["standard_error"] is None
    assert report["measured"]["collisions"]["standard_error"] is None


def test_text_shows_units_and_errors(agglom):
    text = agglom("simulate", "tiny.yaml", "--set", "density=6000", "--samples", 3).stdout
    assert "  density               6000 kg/m^3\n" in text
    assert "mean ± standard error over 3 samples" in text
    assert any("objective" in line and " ± " in line for line in text.splitlines())


def test_the_engine_can_be_another(agglom):
    words = ("simulate", "tiny.yaml", "--samples", 1, "--json", "--engine")
    report = json.loads(agglom(*words, "fixed:100").stdout)
    assert report["measured"]["steps"]["mean"] == 100
    assert json.loads(agglom(*words, "fixed").stdout)["measured"]["steps"]["mean"] == 200


def physical(report):
    """Everything of a report that does not depend on how fast the computer is."""
    measured = {name: value for name, value in report["measured"].items() if "seconds" not in name}
    return measured, report["ledger"], report["objective"]


def test_the_event_engine_takes_events_for_steps_and_closes_the_ledger(agglom):
    words = ("simulate", "tiny.yaml", "--samples", 3, "--json")
    report = json.loads(agglom(*words, "--engine", "event").stdout)
    assert physical(report) == physical(json.loads(agglom(*words).stdout))
    assert report["measured"]["steps"]["mean"] > report["measured"]["collisions"]["mean"] > 0
    assert report["ledger"]["momentum_error"] <= 1e-12
    assert abs(report["ledger"]["energy_error"]) <= 1e-10


def test_the_event_engine_cools_exactly_what_the_file_cools_by_euler_steps(agglom, tmp_path):
    exact = (QUICKSTART.parent / "accretion_2003.yaml").read_text()
    stepped = exact.replace("integration: exact", "integration: euler")
    stepped, count = re.subn(r"engine: event", "engine: {law: fixed, steps: 200}", stepped)
    assert (count, stepped.count("integration: euler")) == (1, 1)
    (tmp_path / "exact.yaml").write_text(exact)
    (tmp_path / "euler.yaml").write_text(stepped)
    words = ("--samples", 2, "--json", "--engine", "event")
    wanted, found = (
        json.loads(agglom("simulate", tmp_path / name, *words).stdout)
        for name in ("exact.yaml", "euler.yaml")
    )
    assert physical(found) == physical(wanted)
    assert found["measured"]["steps"]["mean"] != 200


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["--set", "hardnes=1e8"], "hardnes: unknown variable"),
        (["--set", "hardness=5 kg"], "hardness: wrong unit: 'kg' is mass, expected pressure"),
        (["--set", "hardness=soft"], "hardness: "),
        (["--set", "size_ratio=1.5"], "random placement jams"),
        (["--engine", "fixed:0"], "STEPS must be a whole number from 1"),
        (["--engine", "warp"], "allowed: event, fixed, fixed:STEPS, adaptive"),
        (["--string", "1"], "needs a campaign file"),
    ],
)
def test_what_cannot_be_simulated_is_said_in_one_line(mistaken, arguments, words):
    message = mistaken("simulate", "tiny.yaml", *arguments)
    assert message.startswith("tiny.yaml: ")
    assert words in message


def test_a_setting_needs_a_value(agglom):
    done = agglom("simulate", "tiny.yaml", "--set", "density")
    assert done.exit_code == 2
    assert "'density' is not NAME=VALUE" in done.stderr


def test_a_recorded_sample_is_replayed_bit_for_bit(agglom):
    done = agglom("simulate", "tiny.h5", "--string", 2, "--sample", 3)
    assert done.exit_code == 0
    assert done.stdout.splitlines()[-1] == "identical to the recorded sample"
    report = json.loads(
        agglom("simulate", "tiny.h5", "--string", 2, "--sample", 3, "--json").stdout
    )
    row = read_campaign("tiny.h5").sample_rows(2)[3]
    assert report["measured"]["mean_radius_ratio"]["mean"] == row["mean_radius_ratio"]
    assert report["replay"] == "identical to the recorded sample"


def test_a_recorded_string_is_simulated_as_it_stands(agglom):
    report = json.loads(
        agglom("simulate", "tiny.h5", "--string", 1, "--samples", 2, "--json").stdout
    )
    row = read_campaign("tiny.h5").string_rows()[1]
    for name, value in report["parameters"].items():
        assert value == row[name]
    assert set(report["parameters"]) == set(TEN.names) - {"surface_energy"}
    assert "replay" not in report


def test_a_replay_that_differs_is_told_by_the_exit_code(agglom, monkeypatch):
    monkeypatch.setattr(module, "is_same_sample", lambda *_: False)
    done = agglom("simulate", "tiny.h5", "--string", 2, "--sample", 3)
    assert done.exit_code == 1
    assert done.stdout.splitlines()[-1] == "differs from the recorded sample"


def test_a_changed_row_is_not_the_same(tiny_folder):
    row = read_campaign(tiny_folder / "tiny.h5").sample_rows(0)[0]
    other = row.copy()
    other["merges"] += 1
    assert resimulation.is_same(row, row.copy(), FORMAT_VERSION)
    assert not resimulation.is_same(row, other, FORMAT_VERSION)


def test_a_column_that_an_older_file_lacks_is_not_compared(tiny_folder, monkeypatch):
    since = {"merges": 2}
    later = [c._replace(since=since.get(c.name, 1)) for c in COLUMNS]
    monkeypatch.setattr(resimulation, "COLUMNS", later)
    row = read_campaign(tiny_folder / "tiny.h5").sample_rows(0)[0]
    other = row.copy()
    other["merges"] += 1
    assert resimulation.is_same(row, other, 1)
    assert not resimulation.is_same(row, other, 2)


def test_a_sample_that_fails_is_told_by_the_exit_code(agglom, monkeypatch):
    def fail(*arguments):
        raise RuntimeError("sample 0 failed: non-finite state")

    monkeypatch.setattr(module, "simulate", fail)
    done = agglom("simulate", "tiny.yaml")
    assert (done.exit_code, done.stdout) == (1, "sample 0 failed: non-finite state\n")
    done = agglom("simulate", "tiny.yaml", "--json")
    assert json.loads(done.stdout) == {"failed": "sample 0 failed: non-finite state"}


def test_a_few_samples_that_fail_are_left_out_and_counted(agglom, monkeypatch):
    def sometimes(campaign, parameters, sample=0, engine=None, frames=None):
        if sample in (0, 2):
            raise RuntimeError(f"sample {sample} failed: non-finite state")
        return simulate(campaign, parameters, sample, engine, frames)

    monkeypatch.setattr(module, "simulate", sometimes)
    done = agglom("simulate", "tiny.yaml", "--samples", 5)
    assert done.exit_code == 0
    assert "mean ± standard error over 3 samples" in done.stdout
    assert "2 of 5 samples failed" in done.stdout
    assert done.stdout.splitlines()[-1] == "sample 0 failed: non-finite state"
    report = json.loads(agglom("simulate", "tiny.yaml", "--samples", 5, "--json").stdout)
    assert (report["samples"], report["failed"]) == (3, 2)
    assert report["reasons"] == ["sample 0 failed: non-finite state"]


def test_the_mean_leaves_out_samples_that_find_no_place_as_an_estimate_does(agglom, tmp_path):
    """One sample in eight draws a grain as wide as the box."""
    bonding = {"restitution": "{law: constant, value: 0}", "particles": "50"}
    scene = COLD | bonding | {"sizes": "{law: lognormal, spread: 3}"}
    fraction = {"size_ratio": None, "volume_fraction": "0.3"}
    path = tmp_path / "wide.yaml"
    path.write_text(text_of(scene, COLD_VARIABLES | fraction))
    words = ("simulate", path, "--samples", 60, "--json")
    done = agglom(*words)
    report, estimate = json.loads(done.stdout), estimated(load_campaign(path), {}, 60)
    assert done.exit_code == 0
    assert 0 < report["failed"] == estimate.failed < 60
    assert report["measured"]["merges"]["mean"] == estimate.merges.value
    assert f"{estimate.failed} of 60 samples failed" in agglom(*words[:-1]).stdout


@pytest.mark.parametrize("end_time", ["characteristic", "300 s"])
def test_results_of_a_crowded_box_are_warned_of(agglom, tmp_path, end_time):
    text, path = Path("tiny.yaml").read_text(), tmp_path / "crowded.yaml"
    path.write_text(text.replace("end_time: characteristic", f"end_time: {end_time}"))
    values = {"relative_speed": 30.0, "hardness": 10e6, "size_ratio": 0.8}
    settings = [word for name in values for word in ("--set", f"{name}={values[name]}")]
    done = agglom("simulate", path, *settings, "--samples", 3)
    campaign = load_campaign(path)
    outcomes = [simulate(campaign, values, sample) for sample in range(3)]
    string = campaign.parameters(values)
    early = [changes_until(campaign, string, sample, 0.1) for sample in range(3)]
    merges = [outcome.merges for outcome in outcomes]
    found = [line for line in done.stderr.splitlines() if line.startswith("warning: scene.")]
    said = f"warning: scene.end_time: all {sum(merges)} merges and breakups of 3 samples happen in"
    assert any(line.startswith(said) for line in found) == (early == merges)
    few = sum(outcome.particles for outcome in outcomes) / 3 < 10
    assert any(line.startswith("warning: scene.particles: ") for line in found) == few


def test_changes_until_the_end_are_those_of_the_sample(tiny_folder):
    campaign = load_campaign(tiny_folder / "tiny.yaml")
    string, outcome = campaign.parameters(), simulate(campaign, {}, 3)
    counts = [changes_until(campaign, string, 3, share) for share in (0.0, 0.1, 0.5, 1.0)]
    assert counts == sorted(counts)
    assert counts[0] == 0
    assert counts[-1] == outcome.merges + outcome.breakups > 0
    assert simulate(campaign, {}, 3).record.tobytes() == outcome.record.tobytes()


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ([], "--string: is missing; allowed: 0 to 3"),
        (["--string", "4"], "--string: is 4; allowed: 0 to 3"),
        (["--string", "0", "--sample", "5"], "which string 0 does not have; recorded: 0 to 4"),
        (["--string", "0", "--set", "density=1"], "a recorded string is as it is"),
    ],
)
def test_what_is_not_recorded_is_said_in_one_line(mistaken, arguments, words):
    message = mistaken("simulate", "tiny.h5", *arguments)
    assert message.startswith("tiny.h5: ")
    assert words in message


def test_what_is_no_source_is_said_in_one_line(mistaken, tmp_path):
    (tmp_path / "text.h5").write_text("no database")
    with h5py.File(tmp_path / "other.h5", "w"):
        pass
    assert mistaken("simulate", "nothing.yaml") == "nothing.yaml: no such file"
    assert mistaken("simulate", "nothing.h5") == "nothing.h5: No such file or directory"
    assert "is a directory; a campaign is one YAML file" in mistaken("simulate", tmp_path)
    assert "not an HDF5 file" in mistaken("simulate", tmp_path / "text.h5")
    assert "not an agglom_mpi campaign" in mistaken("simulate", tmp_path / "other.h5")


def test_a_campaign_may_come_from_a_pipe_and_have_any_name(agglom, piped, tmp_path):
    words = ("--samples", 2, "--json")
    named = json.loads(agglom("simulate", "tiny.yaml", *words).stdout)
    text = Path("tiny.yaml").read_text()
    (tmp_path / "campaign.txt").write_text(text)
    for source in (piped(text), tmp_path / "campaign.txt"):
        done = agglom("simulate", source, *words)
        assert done.exit_code == 0, done.stderr
        assert physical(json.loads(done.stdout)) == physical(named)


def test_a_campaign_file_needs_no_yaml_file(agglom, tmp_path, tiny_folder):
    path = write_campaign(tmp_path / "gone.yaml", **SMALL)
    path.unlink()
    done = agglom("simulate", tiny_folder / "tiny.h5", "--string", 0, "--sample", 0)
    assert done.exit_code == 0
