"""`agglom check` on files that are being written, were killed, went on, or failed."""

import os
import signal
import time

import h5py
import numpy as np
import pytest
from farm_runs import (
    SMALL,
    assert_same,
    finish,
    inject,
    invert,
    need_mpirun,
    samples_in,
    start,
    state,
    wait_until,
    write_campaign,
)

from agglom_mpi.database.table import Table
from agglom_mpi.farm.check import check_file

EVERY_SAMPLE_RAISES = """
import agglom_mpi.farm.simulator as simulator

simulate_scene = simulator.simulate_scene

def never(scene, random, abort):
    if not abort[0]:
        raise ArithmeticError("injected")
    return simulate_scene(scene, random, abort)

simulator.simulate_scene = never
"""


def verdict(path):
    text, code = check_file(str(path))
    assert text.startswith(f"{path}: {'damaged' if code else 'sound'}\n"), text
    return code, text


def assert_sound(path):
    code, text = verdict(path)
    assert code == 0, text
    return text


@pytest.mark.parametrize("ranks", [None, 2])
def test_a_file_is_sound_at_every_moment_of_a_run_that_is_killed_and_goes_on(folder, wanted, ranks):
    if ranks is not None:
        need_mpirun()
    path = folder / "slow.h5"
    said = set()
    for leg in range(2):
        process = start(folder, "slow.yaml", ranks=ranks)
        try:
            wait_until(lambda: samples_in(path) > 0, process)
            begin = time.monotonic()
            while process.poll() is None:
                said.add(assert_sound(path))
                if leg == 0 and time.monotonic() - begin > 1.0:
                    os.killpg(process.pid, signal.SIGKILL)
                    process.communicate(timeout=30)
            process.communicate(timeout=30)
        finally:
            if process.poll() is None:
                os.killpg(process.pid, signal.SIGKILL)
                process.communicate(timeout=30)
        assert process.returncode == (-signal.SIGKILL if leg == 0 else 0)
        said.add(assert_sound(path))
    assert len(said) > 10
    assert "\n  digests: 3 of 3 generations verified\n" in assert_sound(path)
    assert_same(path, wanted)


def test_a_stopped_campaign_is_sound_and_a_forged_sample_in_it_is_found(folder):
    path = folder / "slow.h5"
    done = invert(folder, "slow.yaml", "--max-walltime", "1s")
    assert done.returncode == 75
    text = assert_sound(path)
    assert text.endswith("\n  stopped: the walltime limit is reached")
    with h5py.File(path, "r+") as file:
        judged = int(np.flatnonzero(file["results_done"][:])[-1])
        table = Table(file, "samples", path)
        place = judged * int(file.attrs["max_samples"])
        row = table.rows.read(place, 1)
        row["mean_radius_ratio"] *= 1.01
        table.write(place, row)
    code, text = verdict(path)
    assert code == 1
    assert f"replay: the samples give other results of strings {judged}" in text or (
        f"strings {judged}," in text
    )


def test_a_result_or_generation_that_a_stopped_campaign_must_have_is_missed(folder):
    path = folder / "slow.h5"
    assert invert(folder, "slow.yaml", "--max-walltime", "1s").returncode == 75
    with h5py.File(path, "r+") as file:
        judged = int(np.flatnonzero(file["results_done"][:])[-1])
        file["results_done"][judged] = 0
    code, text = verdict(path)
    assert code == 1
    assert f"results: {judged} are absent, though " in text
    assert f"a resume would judge again strings {judged}" in text


def test_a_failed_campaign_is_sound(tmp_path):
    write_campaign(tmp_path / "small.yaml", **SMALL, max_failures=5)
    folder = inject(tmp_path / "inject", EVERY_SAMPLE_RAISES)
    done = invert(tmp_path, "small.yaml", inject=folder)
    assert done.returncode == 1
    assert state(tmp_path / "small.h5")[0] == "failed"
    text = assert_sound(tmp_path / "small.h5")
    assert "5 failures are whole" in text
    assert "\n  failed: 5 samples raised errors" in text


def test_more_generations_and_other_strings_in_one_file_are_sound(folder):
    finish(folder, "slow.yaml", "--generations", "1")
    assert "1 of 1 population\n" in assert_sound(folder / "slow.h5")
    finish(folder, "slow.yaml", "--generations", "2")
    assert "2 of 2 populations\n" in assert_sound(folder / "slow.h5")
    finish(folder, "slow.yaml", "--generations", "1")
    assert_sound(folder / "slow.h5")
