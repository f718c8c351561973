"""What real runs show on terminals of several kinds, and where there is none."""

import os
import re
import shutil
import sys
from pathlib import Path

import numpy as np
import pytest
from campaign_runs import environment, inject, invert, need_mpirun, wait_until, write_campaign
from held_runs import allow, held
from screens import screen, started_on, watched
from test_progress import FULL

from agglom_mpi.display import run_display as module
from agglom_mpi.display.progress import log_line
from agglom_mpi.display.run_display import Display
from agglom_mpi.search.proposals import GenerationSummary
from agglom_mpi.storage.reader import read_campaign

BRIEF = {"generations": 4, "max_samples": 12, "population": 6, "parents": 2}
SHOWS_ALL = """
import agglom_mpi.runtime.coordinator as coordinator
import agglom_mpi.display.run_display as display

coordinator.TICK, display.LOG_INTERVAL = 0.0, 1e9
"""
"""Updates the display whenever there are new samples, and never logs progress."""
TALL = 250
"""Lines of a screen that holds all that a run shows."""

BIN = Path(sys.executable).parent


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    folder = tmp_path_factory.mktemp("shown")
    path = write_campaign(folder / "brief.yaml", **BRIEF, final="{strings: 6, samples: 20}")
    path.write_text(re.sub(r"(?m)^title: .*", "title: A brief one ± 2", path.read_text()))
    inject(folder / "shows", SHOWS_ALL)
    return folder


def seen_on(opened, folder, *command, before=(), **variables):
    """Screens that a run of the brief campaign shows from its beginning to its end."""
    (folder / "brief.h5").unlink(missing_ok=True)
    words = [*before, str(BIN / "agglom-invert"), "brief.yaml", *command]
    env = environment(folder / "shows", TERM="xterm", **variables)
    env.pop("COLUMNS", None)
    with started_on(opened, words, folder, env) as process:
        seen = watched(opened, process)
    assert process.returncode == 0, seen[-1]
    return seen


def assert_live(seen, plus_minus="±"):
    """Generations were counted in place, and nothing of that is left."""
    counts = [
        re.match(r"(\d)/4 generations", line)[1]
        for lines in seen
        for line in lines
        if re.match(r"\d/4 generations", line)
    ]
    assert set(counts) >= {"1", "2", "3"}
    assert counts == sorted(counts)
    for lines in seen:
        assert sum("/4 generations" in line for line in lines) <= 1, lines
        assert sum(" open" in line for line in lines) <= 1, lines
    assert any(re.match(rf"best \S+( {re.escape(plus_minus)} \S+)? \(string", line)
               for lines in seen for line in lines)  # fmt: skip
    last = "\n".join(seen[-1])
    assert "/4 generations" not in last
    assert " busy" not in last
    assert "finished: all 4 generations are done" in " ".join(seen[-1])


def slow(*values):
    return [pytest.param(value, marks=pytest.mark.slow) for value in values]


@pytest.mark.parametrize("columns", [80, *slow(40)])
def test_a_run_shows_lines_in_place_and_then_its_result(folder, columns):
    with screen(columns, TALL) as opened:
        seen = seen_on(opened, folder)
        assert_live(seen)
        assert b"\x1b[?25l" not in opened.raw, "a kill would leave no cursor"
    words = {word for line in seen[-1] for word in line.split()}
    assert {f"#{rank}" for rank in range(1, 6)} <= words, "strings without room follow below"
    assert "string" in words
    assert not any("…" in line for line in seen[-1])


@pytest.mark.slow
@pytest.mark.parametrize(
    "variables",
    [{"LC_ALL": "C"}, {"PYTHONIOENCODING": "ascii"}],
    ids=lambda variables: "=".join(*variables.items()),
)
def test_a_run_survives_any_locale(folder, variables):
    with screen(80, TALL) as opened:
        seen = seen_on(opened, folder, **variables)
        ascii_only = "PYTHONIOENCODING" in variables
        assert_live(seen, "+-" if ascii_only else "±")
        assert opened.raw.isascii() == ascii_only
    if ascii_only:
        assert seen[-1][0] == "A brief one +- 2: at most 18 strings, 1 rank, into brief.h5"


@pytest.mark.ranks(
    guard="display/test_display.py::test_a_run_shows_lines_in_place_and_then_its_result"
)
def test_a_run_under_mpirun_shows_its_lines_on_the_terminal_of_mpirun(folder):
    need_mpirun()
    with screen(80, TALL) as opened:
        seen = seen_on(opened, folder, before=("mpirun", "-n", "2"))
    assert_live(seen)
    assert "2 ranks" in seen[-1][0]


@pytest.mark.slow
def test_ranks_whose_errors_go_to_a_file_show_nothing_on_the_terminal(folder):
    need_mpirun()
    run = f"exec {BIN / 'agglom-invert'} brief.yaml 2>ranks.log"
    with screen(80, 60) as opened:
        (folder / "brief.h5").unlink(missing_ok=True)
        env = environment(folder / "shows", TERM="xterm")
        command = ["mpirun", "-n", "2", "sh", "-c", run]
        with started_on(opened, command, folder, env) as process:
            seen = watched(opened, process)
    assert process.returncode == 0
    assert not any(" busy" in line for lines in seen for line in lines)
    log = (folder / "ranks.log").read_text()
    assert "generation 4/4: best" in log
    assert "\x1b" not in log


@pytest.mark.parametrize("ranks", [None, *slow(2)])
def test_without_a_terminal_there_are_log_lines(folder, ranks, monkeypatch):
    options = {}
    if ranks:
        need_mpirun()
        options = {"ranks": ranks, "inject": folder / "shows", "TERM": "xterm"}
    (folder / "brief.h5").unlink(missing_ok=True)
    monkeypatch.setenv("TERM", "xterm")
    monkeypatch.setattr(module, "LOG_INTERVAL", 1e9)
    done = invert(folder, "brief.yaml", **options)
    assert done.returncode == 0
    errors = done.stderr
    heads = [line.split(":")[0] for line in errors.splitlines()]
    assert [head for head in heads if head != "warning"] == [
        "A brief one ± 2",
        *(f"generation {number}/4" for number in (1, 2, 3, 4)),
        "estimating 6 strings again, on 120 fresh samples",
    ]
    assert "\x1b" not in errors


@pytest.mark.slow
def test_quiet_shows_nothing_on_a_terminal_either(folder):
    with screen(80) as opened:
        assert seen_on(opened, folder, "-q")[-1] == [""]


@pytest.mark.slow
def test_a_run_in_the_background_leaves_the_terminal_to_the_shell(folder):
    """Started by a shell that does job control, as `agglom-invert … &`."""
    bash = shutil.which("bash")
    if bash is None:
        pytest.skip("no bash")
    (folder / "brief.h5").unlink(missing_ok=True)
    script = f"set -m; {BIN / 'agglom-invert'} brief.yaml & wait $!"
    with screen(80, 60) as opened:
        env = environment(folder / "shows", TERM="xterm")
        with started_on(opened, [bash, "-c", script], folder, env) as process:
            seen = watched(opened, process)
    assert process.returncode == 0
    assert not any(" busy" in line for lines in seen for line in lines)
    assert "finished: all 4 generations are done" in " ".join(seen[-1])


@pytest.mark.parametrize("ranks", [None, 2])
@pytest.mark.slow
def test_an_interrupted_run_leaves_a_tidy_terminal(tmp_path, ranks):
    if ranks:
        need_mpirun()
    path = write_campaign(tmp_path / "brief.yaml", **BRIEF | {"generations": 20}).with_suffix(".h5")
    allow(tmp_path, 100)
    command = [str(BIN / "agglom-invert"), "brief.yaml"]
    command = ["mpirun", "-n", "2", *command] if ranks else command
    env = environment(held(tmp_path, text=SHOWS_ALL), TERM="xterm")
    with screen(80, 30) as opened, started_on(opened, command, tmp_path, env) as process:
        wait_until(lambda: opened.read() and path.exists() and in_generation(path), process)
        wait_until(lambda: any("/20 generations" in line for line in opened.read()), process)
        os.write(opened.master, b"\x03")
        last = watched(opened, process)[-1]
    assert not any("/20 generations" in line or " busy" in line for line in last), last
    if not ranks:
        assert process.returncode == 75
        assert "stopped: received SIGINT; everything simulated so far is in brief.h5" in last


def in_generation(path):
    return len(read_campaign(path).generation_rows()) > 0


class Clock:
    """A clock that is set by hand, and the log lines that are written by it."""

    def __init__(self, monkeypatch):
        self.now = 0.0
        monkeypatch.setattr(module.time, "monotonic", lambda: self.now)


def test_progress_is_logged_when_nothing_was_logged_for_long(monkeypatch, capsys):
    clock, display = Clock(monkeypatch), Display()
    with display:
        for _ in range(4 * 86400):
            clock.now += 0.5
            display.tick(FULL)
    logged = capsys.readouterr().err.splitlines()
    assert set(logged) == {log_line(FULL)}
    # One in 20 s for 1000 s, and then one in each 2 % more time: 50 + ln(172.8) / ln(1.02).
    assert 50 + 250 < len(logged) < 50 + 270


def test_progress_is_not_logged_soon_after_something_else(monkeypatch, capsys):
    clock, display = Clock(monkeypatch), Display()
    summary = GenerationSummary(0, 3, np.inf, np.nan, np.inf, np.arange(4), 4, 20)
    with display:
        for _ in range(10):
            clock.now += 15.0
            display.generation(summary, 9, 25, 100.0)
            display.tick(FULL)
    logged = capsys.readouterr().err.splitlines()
    assert logged == ["generation 1/9: best no result (string 3), mean of top inf, 4 strings, "
                      "25 samples, 100/s"] * 10  # fmt: skip
