"""`agglom check` on files that are being written, were killed, went on, or failed."""

import errno
import os
import signal

import h5py
import pytest
from campaign_runs import (
    SMALL,
    assert_killed,
    assert_same,
    finish,
    inject,
    invert,
    need_mpirun,
    running,
    samples_in,
    state,
    wait_until,
    write_campaign,
)
from held_runs import allow, allow_all, held
from processes import output_of

from agglom_mpi.analysis.file_check import check_file
from agglom_mpi.runtime import task_runner as simulator
from agglom_mpi.search.proposals import ORIGINS
from agglom_mpi.storage.reader import read_campaign
from agglom_mpi.storage.table import Table
from agglom_mpi.storage.writer import CampaignWriter

WRITES_AT_ONCE = """
import agglom_mpi.storage.row_buffer as buffer

buffer.FLUSH_AGE = 0.0
"""


def verdict(path):
    text, code = check_file(str(path))
    assert text.startswith(f"{path}: {'damaged' if code else 'sound'}\n"), text
    return code, text


def assert_sound(path):
    code, text = verdict(path)
    assert code == 0, text
    return text


@pytest.mark.slow
def test_a_file_is_sound_at_every_moment_of_a_run_that_is_killed_and_goes_on(folder, wanted):
    need_mpirun()
    path = folder / "small.h5"
    said = set()

    def looked(enough):
        said.add(assert_sound(path))
        return samples_in(path) >= enough

    for leg in range(2):
        allow(folder, 10)
        injected, before = held(folder, text=WRITES_AT_ONCE), samples_in(path)
        with running(folder, "small.yaml", ranks=2, inject=injected) as process:
            wait_until(lambda before=before: samples_in(path) > before, process)
            for more in range(20, 140, 20):
                allow(folder, more)
                wait_until(lambda enough=before + more: looked(enough), process)
            if leg == 0:
                os.killpg(process.pid, signal.SIGKILL)
            else:
                allow_all(folder)
                while process.poll() is None:
                    said.add(assert_sound(path))
            output_of(process)
        assert process.returncode == (-signal.SIGKILL if leg == 0 else 0)
        said.add(assert_sound(path))
    assert len(said) > 10
    assert "\n  digests: 3 of 3 generations verified\n" in assert_sound(path)
    assert_same(path, wanted)


@pytest.fixture
def stop_after(monkeypatch):
    """Return a function that lets the runs of this process be stopped after so many samples."""

    def after(samples):
        simulate_next, left = simulator.Task.simulate_next, samples

        def signalled(task, seconds):
            nonlocal left
            left -= 1
            if left == 0:
                os.kill(os.getpid(), signal.SIGUSR1)
            return simulate_next(task, seconds) if left > 0 else not task._abort_flag.stopped

        monkeypatch.setattr(simulator, "MAX_AT_ONCE", 1)
        monkeypatch.setattr(simulator.Task, "simulate_next", signalled)
        return lambda: monkeypatch.setattr(simulator.Task, "simulate_next", simulate_next)

    return after


@pytest.fixture
def stopped(folder, stop_after):
    """Return the file of a campaign that was stopped in mid generation, and a judged string."""
    path = folder / "small.h5"
    stop_after(200)
    assert invert(folder, "small.yaml").returncode == 75
    assert len(read_campaign(path).result_rows()) > 2
    assert assert_sound(path).endswith("\n  stopped: received SIGUSR1")
    return path, int(read_campaign(path).result_rows()["string"][-1])


def test_a_forged_sample_in_a_generation_that_is_not_over_is_found(stopped):
    path, judged = stopped
    with h5py.File(path, "r+") as file:
        table = Table(file, "samples", path)
        place = judged * int(file.attrs["max_samples"])
        row = table.rows.read(place, 1)
        row["mean_radius_ratio"] *= 1.01
        table.write(place, row)
    code, text = verdict(path)
    assert code == 1
    assert "  replay: the samples give other " in text or "  replay: ends before " in text


def test_a_result_that_a_stopped_campaign_must_have_is_missed(stopped):
    path, judged = stopped
    with h5py.File(path, "r+") as file:
        file["results_done"][judged] = 0
    code, text = verdict(path)
    assert code == 1
    assert f"results: {judged} absent, though " in text
    assert f"a resume would recompute the results of strings {judged}" in text


def test_a_failed_campaign_is_sound(tmp_path, monkeypatch):
    simulate_scene = simulator.simulate_scene

    def never(scene, random, abort, frames=None):
        if not abort[0]:
            raise ArithmeticError("injected")
        return simulate_scene(scene, random, abort, frames)

    monkeypatch.setattr(simulator, "simulate_scene", never)
    monkeypatch.setattr(simulator, "MAX_AT_ONCE", 1)
    write_campaign(tmp_path / "small.yaml", **SMALL, max_failures=5)
    assert invert(tmp_path, "small.yaml").returncode == 1
    assert state(tmp_path / "small.h5")[0] == "failed"
    text = assert_sound(tmp_path / "small.h5")
    failures = len(read_campaign(tmp_path / "small.h5").failures())
    assert failures >= 5
    assert f" and {failures} failures are valid\n" in text
    assert text.endswith(f"\n  failed: {failures} samples failed with errors")


def test_more_generations_and_other_strings_in_one_file_are_sound(folder):
    finish(folder, "small.yaml", "--generations", "1")
    assert "1 of 1 population\n" in assert_sound(folder / "small.h5")
    finish(folder, "small.yaml", "--generations", "2")
    assert "2 of 2 populations\n" in assert_sound(folder / "small.h5")
    finish(folder, "small.yaml", "--generations", "1")
    assert_sound(folder / "small.h5")


KILLED_WHILE_COMPILING = """
import os, signal
import agglom_mpi.runtime.task_runner as simulator

def warm_up(self, show=None):
    os.kill(os.getpid(), signal.SIGKILL)

simulator.SampleRunner.warm_up = warm_up
"""


@pytest.mark.slow
def test_a_continued_campaign_that_is_killed_before_it_begins_is_sound(folder, tmp_path):
    finish(folder, "small.yaml", "--generations", "2")
    path = folder / "small.h5"
    strings = len(read_campaign(path).string_rows())
    injected = inject(tmp_path / "inject", KILLED_WHILE_COMPILING)
    assert invert(folder, "small.yaml", inject=injected).returncode == -signal.SIGKILL
    assert len(read_campaign(path).string_rows()) > strings
    assert_killed(path)
    assert_sound(path)
    finish(folder, "small.yaml")
    assert_sound(path)


def test_a_campaign_cut_to_fewer_generations_than_have_begun_is_sound(folder, stop_after):
    path = folder / "small.h5"
    undo = stop_after(500)
    assert invert(folder, "small.yaml").returncode == 75
    assert len(read_campaign(path).generation_rows()) > 0
    undo()
    done = finish(folder, "small.yaml", "--generations", "1")
    assert "finished already" in done.stderr
    assert state(path)[0] == "finished"
    assert_sound(path)


def test_strings_of_which_a_full_disc_has_kept_some_are_no_damage(folder, wanted, monkeypatch):
    path, put_strings = folder / "small.h5", CampaignWriter.put_strings

    def put_all_but_the_last(self, first, generation, slots, origins, *rest):
        put_strings(self, first, generation, slots, origins, *rest)
        if generation == 1 and ORIGINS[origins[0]] == "offspring":
            self._tables["strings"].mark_absent(first + len(slots) - 1, 1)
            raise OSError(errno.ENOSPC, "No space left on device", str(self.path))

    monkeypatch.setattr(CampaignWriter, "put_strings", put_all_but_the_last)
    assert invert(folder, "small.yaml").returncode == 1
    assert_sound(path)
    monkeypatch.undo()
    finish(folder, "small.yaml")
    assert_same(path, wanted)
