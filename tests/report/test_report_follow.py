"""Runs that are followed from elsewhere, by their files alone."""

import os
import re
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest
from farm_runs import environment, finish, need_mpirun, running, wait_until, write_campaign
from screens import screen, started_on

from agglom_mpi.database.reader import open_campaign
from agglom_mpi.farm import master as master_module
from agglom_mpi.report import follow as module
from agglom_mpi.report.follow import Follower, follow, silence

BRIEF = {"generations": 4, "max_samples": 12, "population": 6, "parents": 2}
AGGLOM = str(Path(sys.executable).parent / "agglom")


@pytest.fixture
def folder(tmp_path):
    write_campaign(tmp_path / "brief.yaml", **BRIEF, final="{strings: 2, samples: 10}")
    write_campaign(tmp_path / "long.yaml", **BRIEF | {"generations": 60})
    return tmp_path


@pytest.fixture(scope="module")
def finished(tmp_path_factory):
    folder = tmp_path_factory.mktemp("finished")
    write_campaign(folder / "brief.yaml", **BRIEF, final="{strings: 2, samples: 10}")
    finish(folder, "brief.yaml")
    return open_campaign(folder / "brief.h5")


def following(folder, name, **options):
    return subprocess.Popen(
        [AGGLOM, "report", name, "--follow"],
        cwd=folder,
        env=environment(TERM="xterm"),
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        **options,
    )


def generations_in(path):
    return len(open_campaign(path).generation_rows()) if path.exists() else 0


@pytest.mark.parametrize("ranks", [None, 2])
def test_a_run_is_followed_to_its_end_in_log_lines(folder, ranks):
    if ranks:
        need_mpirun()
    with running(folder, "brief.yaml", ranks=ranks) as process:
        wait_until(lambda: generations_in(folder / "brief.h5") >= 1, process)
        watch = following(folder, "brief.h5")
        said, errors = watch.communicate(timeout=60)
        process.communicate(timeout=60)
        assert process.returncode == 0
    assert watch.returncode == 0
    numbers = [re.match(r"generation (\d)/4: best", line)[1] for line in errors.splitlines()]
    assert numbers == sorted(set(numbers))
    assert numbers[-1] == "4"
    assert len(numbers) >= (1 if ranks else 2), "two ranks may be too fast"
    assert "finished: all 4 generations are done" in said


def test_a_run_is_followed_on_a_terminal(folder):
    with running(folder, "long.yaml") as process, screen(80, 60) as opened:
        path = folder / "long.h5"
        wait_until(lambda: generations_in(path) >= 1, process)
        env = environment(TERM="xterm")
        watch = started_on(opened, [AGGLOM, "report", "long.h5", "--follow"], folder, env)
        wait_until(lambda: any(" busy" in line for line in opened.read(0.05)), watch)
        assert any(re.match(r"\d+/60 generations  0:\d\d", line) for line in opened.lines)
        os.write(opened.master, b"\x03")
        assert watch.wait(timeout=20) == 130
        assert opened.read(0.2) == [""]
        assert process.poll() is None, "whoever is followed does not notice"


def test_a_stopped_run_ends_with_its_exit_code(folder):
    with running(folder, "long.yaml") as process:
        wait_until(lambda: generations_in(folder / "long.h5") >= 1, process)
        watch = following(folder, "long.h5")
        time.sleep(1.0)
        os.kill(process.pid, signal.SIGUSR1)
        process.communicate(timeout=30)
        said, _ = watch.communicate(timeout=30)
    assert watch.returncode == 75
    assert "stopped: received SIGUSR1" in said


def test_a_killed_run_is_told_since_when_it_is_silent_and_its_successor_is_followed(
    folder, monkeypatch
):
    path = folder / "brief.h5"
    with running(folder, "brief.yaml") as process:
        wait_until(lambda: generations_in(path) >= 1, process)
        process.kill()
        process.communicate(timeout=30)
    killed = time.time()
    follower = Follower(open_campaign(path))
    at_once, later = follower.look(killed), follower.look(killed + 300.0)
    assert at_once.note == ""
    last = open_campaign(path).all_sample_rows()["finished"].max()
    clock = time.strftime("%H:%M:%S", time.localtime(last))
    assert re.match(
        rf"nothing has changed since {clock}, for [45] min( \d+ s)?: was it killed\?", later.note
    )
    assert later.left is None
    assert later.rate == pytest.approx(at_once.rate, rel=0.5), "silence is no time of work"
    finish(folder, "brief.yaml")
    after = follower.look(time.time())
    assert after.note == ""
    assert follower.news.status.state == "finished"
    assert [summary.generation for summary in follower.new_generations()][-1] == 3


def test_what_was_read_piece_by_piece_is_what_is_there(folder):
    path = folder / "brief.h5"
    with running(folder, "brief.yaml") as process:
        wait_until(lambda: generations_in(path) >= 1, process)
        follower = Follower(open_campaign(path))
        while process.poll() is None:
            follower.look(time.time())
            time.sleep(0.1)
        process.communicate(timeout=30)
    follower.look(time.time())
    rows = open_campaign(path).all_sample_rows()
    found = np.sort(follower.news.samples, order=["string", "sample"])
    for name in found.dtype.names:
        assert found[name].tolist() == rows[name].tolist()


def test_the_file_tells_what_rank_0_knew(folder, monkeypatch):
    """What rank 0 shows at the end of a generation, and what its file says then."""
    from agglom_mpi.campaign import load_campaign
    from agglom_mpi.database.writer import CampaignWriter
    from agglom_mpi.farm.clock import StopRequest
    from agglom_mpi.farm.crew import Crew
    from agglom_mpi.farm.simulator import Simulator
    from agglom_mpi.farm.store import leg_fields, prepare
    from agglom_mpi.farm.work import CampaignWork

    monkeypatch.setattr(master_module, "TICK", 0.0)
    monkeypatch.chdir(folder)
    work = CampaignWork(load_campaign("brief.yaml"))
    path = folder / "brief.h5"
    pairs = []

    class Watcher:
        def generation(self, *_): ...
        def message(self, text): ...
        def error(self, text):
            raise AssertionError(text)

        def tick(self, progress):
            writer.flush()
            pairs.append((progress, follower.look(time.time())))

    file = prepare(path, work, accept_code_change=False)
    with CampaignWriter(path) as writer:
        master = master_module.Master(work, file, writer, Watcher())
        master.replay()
        simulator = Simulator(work, 0)
        simulator.warm_up()
        writer.begin_leg(**leg_fields(1, ""))
        writer.set_status("running")
        follower = Follower(open_campaign(path))
        crew = Crew(simulator, None)
        master.wind_up(crew, master.run(crew, StopRequest(None)))
    assert {(known.unit, known.total) for known, _ in pairs} == {
        ("generations", 4),
        ("fresh samples", 20),
    }
    assert {known.done for known, _ in pairs if known.unit == "generations"} >= {1, 2, 3}
    for known, read in pairs:
        if known.unit == "fresh samples" and known.done == 0:
            continue  # that the search is over is not in the file before the first of them
        names = ("done", "total", "unit", "samples", "strings_open", "failed", "best", "at_most")
        for name in names:
            assert getattr(known, name) == getattr(read, name), name
        assert (known.left is None) == (read.left is None)


def test_a_finished_file_is_told_at_once(finished, capsys):
    assert follow(finished) == 0
    logged = capsys.readouterr().err.splitlines()
    assert len(logged) == 1
    assert logged[0].startswith("generation 4/4: best ")


def test_looks_take_a_small_share_of_the_time(finished, monkeypatch):
    """A file that takes long to look at is looked at less often."""
    clock, naps = [0.0], []

    class Slow(Follower):
        def look(self, now):
            progress = super().look(now)
            clock[0] += 3.0
            self.news.status = self.news.status._replace(state="running")
            return progress

    def nap(seconds):
        naps.append(seconds)
        clock[0] += seconds
        if len(naps) == 3:
            raise KeyboardInterrupt

    monkeypatch.setattr(module, "Follower", Slow)
    monkeypatch.setattr(module.time, "monotonic", lambda: clock[0])
    monkeypatch.setattr(module.time, "sleep", nap)
    assert follow(finished) == 130
    assert naps == [pytest.approx(60.0)] * 3


def test_long_silence_is_told_with_its_day():
    now = time.mktime((2026, 3, 4, 12, 0, 0, 0, 0, -1))
    assert silence(now - 65.0, now) == (
        "nothing has changed since 11:58:55, for 1 min 5 s: was it killed?"
    )
    assert "since 2026-03-01 12:00, for 3 d:" in silence(now - 3 * 86400.0, now)
