"""`agglom accuracy --answer`: a tiny study, plain, with ranks, stopped, killed, and bad input."""

import csv
import os
import shutil
import signal
import subprocess
from pathlib import Path

import numpy as np
import pytest
from agglom_here import agglom_here
from campaign_runs import QUICKSTART, SLOWLY, environment, inject, need_mpirun
from processes import HANG, end_group, start_group, wait_for

from agglom_mpi.accuracy.answer.errors import first_fresh_sample
from agglom_mpi.config.answer_study import load_answer_study
from agglom_mpi.config.loading import load_campaign
from agglom_mpi.storage.reader import read_campaign
from agglom_mpi.verbs.simulate import simulate

STUDY = """
title: Tiny
question: quickstart.yaml
seeds: 2
samples: 8
targets: [0.5, 0.2]
compared: 0.2
default:
  search: {method: sobol, population: 4}
  ensemble: {rule: fixed, samples: 2}
  stopping: {generations: 2}
factors:
  grains:
    50 grains: {scene: {particles: 50}}
"""
SET = """
question: quickstart.yaml
answer: set
tolerance: 0.1
points: 64
seeds: 2
samples: 20
targets: [1.0, 0.5]
compared: 0.5
default:
  search: {method: sobol, population: 32}
  ensemble: {rule: fixed, samples: 1}
  stopping: {generations: 3}
factors:
  searches:
    random: {search: {method: random, population: 32}}
"""
PROCESSOR_TIME = "processor time"


def write(folder, text=STUDY):
    (folder / "quickstart.yaml").write_text(QUICKSTART.read_text())
    (folder / "study.yaml").write_text(text)
    return folder


def command(*arguments, ranks=None):
    words = ["agglom", "accuracy", "study.yaml", "--answer", "--out", "out", *arguments]
    return words if ranks is None else ["mpirun", "-n", str(ranks), *words]


def run(folder, *arguments, ranks=None):
    if ranks is None:
        return agglom_here(folder, *command(*arguments)[1:])
    return subprocess.run(
        command(*arguments, ranks=ranks),
        cwd=folder,
        env=environment(),
        capture_output=True,
        text=True,
        timeout=HANG,
        check=False,
    )


def numbers(folder, name="answers.csv"):
    """Return the rows of a table, without processor times."""
    with open(folder / "out" / name, newline="") as file:
        return [
            {key: value for key, value in row.items() if PROCESSOR_TIME not in key}
            for row in csv.DictReader(file)
        ]


@pytest.fixture(scope="module")
def studied(tmp_path_factory):
    folder = write(tmp_path_factory.mktemp("answer"))
    done = run(folder)
    assert done.returncode == 0, done.stderr
    return folder


def test_a_study_reports_every_setting_with_its_figures_and_tables(studied):
    text = (studied / "out" / "report.md").read_text()
    assert text.startswith("# The error of the answer against its cost: Tiny")
    for name in ("default", "50 grains"):
        assert f"| {name} |" in text
    assert (studied / "out" / "answer_grains.png").stat().st_size > 1000
    rows = numbers(studied)
    assert len(rows) == 2 * 2 * 2
    expected = numbers(studied, "expected_run_times.csv")
    assert {(row["setting"], row["target"]) for row in expected} == {
        (setting, target) for setting in ("default", "50 grains") for target in ("0.5", "0.2")
    }


def test_errors_are_those_of_fresh_samples_in_the_scene_of_the_question(studied):
    again = read_campaign(studied / "out" / "estimates.h5")
    question = load_campaign(str(studied / "quickstart.yaml"))
    first = first_fresh_sample(load_answer_study(str(studied / "study.yaml")))
    for path in (studied / "out" / "runs").glob("*.h5"):
        assert read_campaign(path).all_sample_rows()["sample"].max() < first
    rows = {row["setting"]: row for row in numbers(studied)}
    for row in rows.values():
        found = again.sample_rows(int(row["string"]))
        string = again.parameters[int(row["string"])]
        ratios = [simulate(question, string, first + i).mean_radius_ratio for i in range(8)]
        assert found["mean_radius_ratio"].tolist() == ratios
        assert float(row["re-estimate"]) == pytest.approx(abs(np.mean(ratios) / 2.0 - 1.0))


def test_a_finished_study_only_writes_its_report_again(studied):
    files = sorted((studied / "out").rglob("*.h5"))
    before, rows = [path.read_bytes() for path in files], numbers(studied)
    (studied / "out" / "answers.csv").unlink()
    done = run(studied)
    assert done.returncode == 0, done.stderr
    assert [path.read_bytes() for path in files] == before
    assert numbers(studied) == rows


@pytest.mark.slow
def test_a_kill_in_the_middle_changes_no_answer(studied, tmp_path):
    folder = write(tmp_path)
    slowly = inject(tmp_path / "slowly", SLOWLY)
    process = start_group(command(), cwd=folder, env=environment(slowly))
    try:
        runs = folder / "out" / "runs"
        wait_for(lambda: (runs / "default_seed2.h5").exists(), "the second run", process)
        os.killpg(process.pid, signal.SIGKILL)
        process.wait()
    finally:
        end_group(process)
    assert not (folder / "out" / "report.md").exists()
    done = run(folder)
    assert done.returncode == 0, done.stderr
    assert numbers(folder) == numbers(studied)
    assert numbers(folder, "expected_run_times.csv") == numbers(studied, "expected_run_times.csv")


@pytest.mark.slow
def test_ranks_and_a_stop_in_between_change_no_answer(studied, tmp_path):
    need_mpirun()
    folder = write(tmp_path)
    stopped = run(folder, "--max-walltime", "0.01", ranks=2)
    assert stopped.returncode == 75, stopped.stderr
    done = run(folder, ranks=2)
    assert done.returncode == 0, done.stderr
    assert numbers(folder) == numbers(studied)
    ranks = {
        path.stem: set(read_campaign(path).all_sample_rows()["rank"].tolist())
        for path in (folder / "out" / "runs").glob("*.h5")
    }
    assert all(found == {0} for found in ranks.values())  # of each run one rank, and it alone


@pytest.mark.slow
def test_a_signal_to_rank_0_stops_all_ranks(tmp_path):
    need_mpirun()
    folder = write(tmp_path, STUDY.replace("generations: 2", "generations: 500"))
    slowly = inject(tmp_path / "slowly", f"import os\n{NAMED}{SLOWLY}")
    process = start_group(command(ranks=2), cwd=folder, env=environment(slowly))
    try:
        first = folder / "out" / "runs" / "default_seed1.h5"
        wait_for(lambda: first.exists() and pid_of(slowly, 0) is not None, "a run", process)
        os.kill(pid_of(slowly, 0), signal.SIGUSR1)
        assert process.wait(timeout=HANG) == 75
    finally:
        end_group(process)
    for path in (folder / "out" / "runs").glob("*.h5"):
        assert read_campaign(path).status().state == "stopped"


NAMED = """
from pathlib import Path
rank = os.environ.get("PMI_RANK", os.environ.get("OMPI_COMM_WORLD_RANK"))
if rank is not None:
    Path(__file__).with_name(f"pid-{rank}").write_text(str(os.getpid()))
"""


def pid_of(folder: Path, rank: int) -> int | None:
    path = folder / f"pid-{rank}"
    return int(path.read_text() or 0) or None if path.exists() else None


@pytest.mark.slow
def test_a_study_of_a_set_compares_it_with_the_true_one(tmp_path):
    folder = write(tmp_path, SET)
    done = run(folder)
    assert done.returncode == 0, done.stderr
    rows = numbers(folder)
    again = read_campaign(folder / "out" / "estimates.h5")
    truth = [
        abs(again.sample_rows(i)["mean_radius_ratio"].mean() / 2.0 - 1.0) <= 0.1
        for i in range(len(again.string_rows()))
    ]
    assert sum(truth) > 0
    first = [row for row in rows if row["generation"] == "1"]
    assert len(first) == 4  # 64 strings; after 32 there is no set
    for row in rows:
        assert float(row["error"]) >= abs(int(row["members"]) - sum(truth)) / sum(truth) - 1e-12


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["other.yaml", "--answer", "-o", "x"], "other.yaml: no such file"),
        (["study.yaml", "--answer", "-o", "x", "--quick"], "--quick"),
        (["study.yaml", "other.yaml", "--answer", "-o", "x"], "not 2"),
        (["quickstart.yaml", "--answer", "-o", "x"], "quickstart.yaml:"),
    ],
)
def test_bad_input_is_one_message_and_leaves_nothing(studied, arguments, message):
    done = agglom_here(studied, "accuracy", *arguments)
    assert done.returncode == 2
    assert message in done.stderr
    assert "Traceback" not in done.stderr
    assert not (studied / "x").exists()


def test_another_study_in_the_same_folder_is_refused(studied, tmp_path):
    folder = write(tmp_path, STUDY.replace("samples: 2}", "samples: 3}"))
    shutil.copytree(studied / "out", folder / "out")
    done = run(folder)
    assert done.returncode == 2
    assert "default_seed1.h5: belongs to another campaign" in done.stderr
    assert "ensemble.samples" in done.stderr
    assert "Traceback" not in done.stderr


def test_something_else_in_place_of_a_run_is_named(tmp_path):
    folder = write(tmp_path)
    (folder / "out" / "runs").mkdir(parents=True)
    (folder / "out" / "runs" / "default_seed1.h5").write_text("no campaign")
    done = run(folder)
    assert done.returncode == 2
    assert "default_seed1.h5" in done.stderr
    assert len(done.stderr.strip().splitlines()) == 1
