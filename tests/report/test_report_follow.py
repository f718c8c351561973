"""Progress of runs as another process reads it from their files."""

import os
import re
import shutil
import signal
import sys
import time
from contextlib import contextmanager
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from campaign_runs import (
    environment,
    finish,
    need_mpirun,
    running,
    wait_until,
    write_campaign,
)
from click.testing import CliRunner
from held_runs import allow, allow_all, held
from processes import output_of, wait_for
from screens import screen, started_on

from agglom_mpi.cli import main
from agglom_mpi.config.loading import load_campaign
from agglom_mpi.display import run_display as display
from agglom_mpi.report import follow as module
from agglom_mpi.report.follow import FileProgress, follow, silence_note
from agglom_mpi.runtime import coordinator as coordinator_module
from agglom_mpi.runtime.experiment import InversionExperiment
from agglom_mpi.runtime.file_setup import prepare
from agglom_mpi.runtime.provenance import leg_start
from agglom_mpi.runtime.stop_request import StopRequest
from agglom_mpi.runtime.task_runner import SampleRunner
from agglom_mpi.runtime.worker_pool import WorkerPool
from agglom_mpi.storage.reader import read_campaign
from agglom_mpi.storage.writer import CampaignWriter

BRIEF = {"generations": 4, "max_samples": 12, "population": 6, "parents": 2}
SHOWN_BY_BOTH = (
    "done",
    "total",
    "unit",
    "samples",
    "strings_open",
    "failed",
    "best",
    "may_end_sooner",
)
"""Attributes of a progress that a file shows exactly."""
AGGLOM = str(Path(sys.executable).parent / "agglom")


@pytest.fixture(scope="module")
def carried_out(tmp_path_factory):
    """Run a campaign in this process, and read its progress from its file at the same time.

    In the folder is a copy of the file as a kill would have left it after the first generation.
    The pairs are the progress that rank 0 knew and the one that was read.
    """
    folder = tmp_path_factory.mktemp("carried_out")
    path = write(folder).with_suffix(".h5")
    work, pairs = InversionExperiment(load_campaign(folder / "brief.yaml")), []

    class Listener:
        def generation(self, *_): ...
        def message(self, text): ...
        def error(self, text):
            raise AssertionError(text)

        def tick(self, progress):
            writer.flush()
            pairs.append((progress, reader.read(time.time())))
            if len(reader.data.generation_rows()) == 1:
                shutil.copy(path, folder / "killed.h5")

    file = prepare(path, work, accept_code_change=False)
    with pytest.MonkeyPatch.context() as patch, CampaignWriter(path) as writer:
        patch.setattr(coordinator_module, "TICK", 0.0)
        patch.setattr(module, "SILENCE", 1e9)
        coordinator = coordinator_module.Coordinator(work, file, writer, Listener())
        coordinator.replay(StopRequest())
        runner = SampleRunner(work, 0)
        runner.warm_up()
        writer.log.begin_leg(**leg_start(1, ""))
        writer.set_status("running")
        reader = FileProgress(read_campaign(path))
        pool = WorkerPool(runner, None)
        coordinator.shut_down(pool, coordinator.run(pool, StopRequest(None)))
    return folder, reader, pairs


@pytest.fixture
def folder(carried_out, tmp_path):
    """Return a folder with the campaign, and a file of it that was killed."""
    shutil.copy(carried_out[0] / "killed.h5", tmp_path / "brief.h5")
    write(tmp_path)
    return tmp_path


def write(folder):
    return write_campaign(folder / "brief.yaml", **BRIEF, final="{strings: 2, samples: 10}")


@contextmanager
def begun(folder, ranks=None):
    """Run a campaign for a block that begins after its first generation, and is held there."""
    write(folder)
    allow(folder, 80)
    with running(folder, "brief.yaml", ranks=ranks, inject=held(folder)) as process:
        wait_until(lambda: generations_in(folder / "brief.h5") >= 1, process)
        yield process


def generations_in(path):
    return len(read_campaign(path).generation_rows()) if path.exists() else 0


@pytest.fixture
def followed(monkeypatch):
    """Return a function that follows a campaign, and calls another one after its first reading."""

    def result(path, then):
        actions = [then]

        def nap(seconds):
            if actions:
                actions.pop()()
            time.sleep(0.01)

        monkeypatch.setattr(module, "time", SimpleNamespace(**vars(time) | {"sleep": nap}))
        monkeypatch.setattr(display, "LOG_INTERVAL", 1e9)
        return CliRunner().invoke(main, ["report", str(path), "--follow"])

    return result


def assert_followed_to_its_end(watch):
    assert watch.exit_code == 0
    numbers = re.findall(r"^generation (\d)/4: best", watch.stderr, re.MULTILINE)
    assert numbers == sorted(set(numbers))
    assert numbers[-1] == "4"
    assert len(numbers) >= 2
    assert "finished: all 4 generations are done" in watch.stdout


def test_a_campaign_that_goes_on_is_followed_to_its_end_in_log_lines(folder, followed):
    watch = followed(folder / "brief.h5", lambda: finish(folder, "brief.yaml"))
    assert_followed_to_its_end(watch)
    assert watch.stderr.count("generation ") == 4


@pytest.mark.slow
@pytest.mark.parametrize("ranks", [None, 2])
def test_a_run_is_followed_to_its_end_in_log_lines(tmp_path, followed, ranks):
    if ranks:
        need_mpirun()
    with begun(tmp_path, ranks) as process:
        watch = followed(tmp_path / "brief.h5", lambda: allow_all(tmp_path))
        output_of(process)
        assert process.returncode == 0
    assert_followed_to_its_end(watch)


def test_a_run_is_followed_on_a_terminal(tmp_path):
    command, env = [AGGLOM, "report", "brief.h5", "--follow"], environment(TERM="xterm")
    with (
        begun(tmp_path) as process,
        screen(80, 60) as opened,
        started_on(opened, command, tmp_path, env) as watch,
    ):
        wait_until(lambda: any(" busy" in line for line in opened.read()), watch)
        assert any(re.match(r"\d+/4 generations  \d+:\d\d", line) for line in opened.lines)
        os.write(opened.master, b"\x03")
        wait_for(lambda: opened.read() and watch.poll() is not None, "end")
        assert watch.returncode == 130
        assert opened.read() == [""]
        assert process.poll() is None, "whoever is followed does not notice"


def test_a_run_that_has_not_begun_is_waited_for(folder, followed):
    path = folder / "brief.h5"
    path.rename(folder / "later.h5")
    watch = followed(path, lambda: finish(folder, "brief.yaml"))
    assert watch.exit_code == 0
    assert "does not exist yet" in watch.stderr
    assert "finished: all 4 generations are done" in watch.stdout


def test_a_stopped_run_ends_with_its_exit_code(folder, followed):
    def stop():
        with CampaignWriter(folder / "brief.h5") as writer:
            writer.set_status("stopped", "received SIGUSR1")

    watch = followed(folder / "brief.h5", stop)
    assert watch.exit_code == 75
    assert "stopped: received SIGUSR1" in watch.stdout


@pytest.mark.slow
def test_a_run_that_is_told_to_stop_is_followed_to_its_exit_code(tmp_path, followed):
    with begun(tmp_path) as process:
        watch = followed(tmp_path / "brief.h5", lambda: os.kill(process.pid, signal.SIGUSR1))
        output_of(process)
    assert watch.exit_code == 75
    assert "stopped: received SIGUSR1" in watch.stdout


def test_of_a_killed_run_the_time_of_silence_is_shown_and_its_successor_is_followed(folder):
    path = folder / "brief.h5"
    last = read_campaign(path).all_sample_rows()["finished"].max()
    reader = FileProgress(read_campaign(path))
    at_once, later = reader.read(last), reader.read(last + 300.0)
    assert at_once.note == ""
    clock = time.strftime("%H:%M:%S", time.localtime(last))
    assert re.match(
        rf"nothing has changed since {clock}, for [45] min( \d+ s)?: the run was killed", later.note
    )
    assert later.remaining is None
    assert later.rate == pytest.approx(at_once.rate), "silence is no time of work"
    finish(folder, "brief.yaml")
    after = reader.read(time.time())
    assert after.note == ""
    assert reader.data.status().state == "finished"
    assert [summary.generation for summary in reader.new_generations()][-1] == 3


def test_rows_read_one_after_the_other_are_those_of_the_file(carried_out):
    folder, reader, pairs = carried_out
    assert len({read.samples for _, read in pairs}) > 5
    reader.read(time.time())
    rows = read_campaign(folder / "brief.h5").all_sample_rows()
    found = np.sort(reader.data.all_sample_rows(), order=["string", "sample"])
    for name in found.dtype.names:
        assert found[name].tolist() == rows[name].tolist()


def test_the_file_shows_the_progress_that_rank_0_shows(carried_out):
    """What rank 0 shows at the end of a generation, and what its file says then."""
    *_, pairs = carried_out
    assert {(known.unit, known.total) for known, _ in pairs} == {
        ("generations", 4),
        ("fresh samples", 20),
    }
    assert {known.done for known, _ in pairs if known.unit == "generations"} >= {1, 2, 3}
    for known, read in pairs:
        if known.unit == "fresh samples" and known.done == 0:
            continue  # that the search is over is not in the file before the first of them
        for name in SHOWN_BY_BOTH:
            assert getattr(known, name) == getattr(read, name), name
        assert (known.remaining is None) == (read.remaining is None)


def test_a_finished_file_is_shown_at_once(finished, capsys):
    assert follow(read_campaign(finished)) == 0
    logged = capsys.readouterr().err.splitlines()
    assert len(logged) == 1
    assert logged[0].startswith("generation 3/3: best ")


def test_reading_takes_a_small_share_of_the_time(finished, monkeypatch):
    """A file that takes long to read is read less often."""
    clock, naps = [0.0], []

    class Slow(FileProgress):
        def read(self, now):
            progress = super().read(now)
            clock[0] += 3.0
            status = self.data.status()._replace(state="running")
            self.data.status = lambda: status
            return progress

    def nap(seconds):
        naps.append(seconds)
        clock[0] += seconds
        if len(naps) == 3:
            raise KeyboardInterrupt

    monkeypatch.setattr(module, "FileProgress", Slow)
    monkeypatch.setattr(module.time, "monotonic", lambda: clock[0])
    monkeypatch.setattr(module.time, "sleep", nap)
    assert follow(read_campaign(finished)) == 130
    assert naps == [pytest.approx(60.0)] * 3


def test_a_long_silence_is_shown_with_its_date():
    now = time.mktime((2026, 3, 4, 12, 0, 0, 0, 0, -1))
    assert silence_note(now - 65.0, now) == (
        "nothing has changed since 11:58:55, for 1 min 5 s: was it killed?"
    )
    assert "since 2026-03-01 12:00, for 3 d:" in silence_note(now - 3 * 86400.0, now)
