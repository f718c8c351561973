"""The scripts in slurm/, each submitted to a real Slurm."""

import pytest
from campaign_runs import (
    SMALL,
    TINY,
    assert_same,
    assert_sound,
    decisions,
    finish,
    samples_in,
    state,
    write_campaign,
)
from held_runs import allow, allow_all, held
from slurm_daemons import script

from agglom_mpi.storage.reader import read_campaign

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def wanted(shared_campaign):
    """What every run of the campaign must decide."""
    return decisions(shared_campaign("small") / "small.h5")


def export(folder):
    """Option that lets the runs of a job be held."""
    return f"--export=ALL,PYTHONPATH={held(folder)}"


@pytest.fixture(scope="module", autouse=True)
def limited(slurm, tmp_path_factory):
    """Submit a job that stays a minute and is sent no signal, before the other tests; both."""
    folder = tmp_path_factory.mktemp("limited")
    write_campaign(folder / "long.yaml", **SMALL)
    allow(folder, 100)
    about = ("-n1", "--time=2", "--signal=B:URG@5", export(folder))
    return folder, slurm.submit(folder, *about, script("campaign.sbatch"), "long.yaml")


@pytest.fixture
def begun(slurm, tmp_path):
    """Submit the campaign; return its folder and job when there are some samples, and no more."""
    write_campaign(tmp_path / "small.yaml", **SMALL)
    allow(tmp_path, 100)
    job = slurm.submit(tmp_path, "-n2", export(tmp_path), script("campaign.sbatch"), "small.yaml")

    def enough():
        return samples_in(tmp_path / "small.h5") >= 20 or slurm.has_ended(job)

    slurm.wait(enough, "no samples")
    assert not slurm.has_ended(job), said(tmp_path, job)
    return tmp_path, job


def said(folder, job):
    return (folder / f"slurm-{job}.out").read_text()


def legs(path):
    return [int(code) for code in read_campaign(path).legs()["exit_code"]]


def test_a_job_that_nears_its_walltime_stops_requeues_itself_and_finishes(slurm, begun, wanted):
    folder, job = begun
    slurm.wait(lambda: slurm.hands_signals_on(job), "does not run")
    slurm("scancel", "--signal=USR1", "--batch", job)
    slurm.wait(lambda: slurm.restarts(job) == 1, "not requeued")
    allow_all(folder)
    assert state(folder / "small.h5")[0] in ("stopped", "running")
    assert_sound(folder / "small.h5")
    slurm.wait(lambda: slurm.has_ended(job), "does not end")
    assert slurm.state(job) == "COMPLETED", said(folder, job)
    assert legs(folder / "small.h5") == [75, 0]
    assert_same(folder / "small.h5", wanted)
    assert_sound(folder / "small.h5")
    assert "received SIGUSR1" in said(folder, job)


def test_a_job_that_is_cancelled_leaves_a_sound_file_that_another_finishes(slurm, begun, wanted):
    folder, job = begun
    slurm("scancel", job)
    slurm.wait(lambda: slurm.has_ended(job), "does not end")
    assert slurm.state(job) == "CANCELLED"
    go_on(slurm, folder, wanted)


def test_a_job_that_is_killed_hard_leaves_a_sound_file_that_another_finishes(slurm, begun, wanted):
    folder, job = begun
    slurm("scancel", "--signal=KILL", "--full", job)
    slurm.wait(lambda: slurm.has_ended(job), "does not end")
    go_on(slurm, folder, wanted)


def go_on(slurm, folder, wanted):
    """Submit the campaign again, and see it end like an undisturbed run."""
    assert_sound(folder / "small.h5")
    assert samples_in(folder / "small.h5") >= 20
    job = slurm.submit(folder, "-n2", script("campaign.sbatch"), "small.yaml")
    slurm.wait(lambda: slurm.has_ended(job), "does not end")
    assert slurm.state(job) == "COMPLETED", said(folder, job)
    assert_same(folder / "small.h5", wanted)
    assert_sound(folder / "small.h5")


def test_a_file_that_is_bad_fails_the_job_once_and_for_all(slurm, tmp_path):
    (tmp_path / "bad.yaml").write_text("seed: none\n")
    job = slurm.submit(tmp_path, "-n2", script("campaign.sbatch"), "bad.yaml")
    slurm.wait(lambda: slurm.has_ended(job), "does not end")
    assert (slurm.state(job), slurm.restarts(job)) == ("FAILED", 0)
    assert "bad.yaml:1: seed" in said(tmp_path, job)


def test_an_array_of_seeds_is_compared_by_a_job_that_depends_on_it(slurm, tmp_path):
    write_campaign(tmp_path / "tiny.yaml", **TINY)
    array = slurm.submit(tmp_path, "-n2", "--array=3,5", script("array.sbatch"), "tiny.yaml")
    names = ["tiny_seed3", "tiny_seed5"]
    files = [f"{name}.h5" for name in names]
    after = slurm.submit(tmp_path, f"--dependency=afterok:{array}", script("report.sbatch"), *files)
    slurm.wait(lambda: slurm.has_ended(after), "does not end")
    assert slurm.state(after) == "COMPLETED", said(tmp_path, after)
    assert "seed: 3, 5\n" in said(tmp_path, after)
    for seed, name in zip([3, 5], names, strict=True):
        write_campaign(tmp_path / "alone.yaml", **TINY, seed=seed)
        finish(tmp_path, "alone.yaml", "-o", f"alone{seed}.h5")
        assert_same(tmp_path / f"{name}.h5", decisions(tmp_path / f"alone{seed}.h5"))


def test_one_task_of_an_array_that_stops_early_is_requeued_alone(slurm, tmp_path):
    for name in ("one", "two"):
        write_campaign(tmp_path / f"{name}.yaml", **SMALL)
    allow(tmp_path, 100)
    about = ("-n1", export(tmp_path), "--array=0-1")
    array = slurm.submit(tmp_path, *about, script("array.sbatch"), "one.yaml", "two.yaml")
    slurm.wait(lambda: samples_in(tmp_path / "two.h5") >= 10, "no samples")
    slurm.wait(lambda: slurm.hands_signals_on(f"{array}_1"), "does not run")
    slurm("scancel", "--signal=USR1", "--batch", f"{array}_1")
    slurm.wait(lambda: slurm.restarts(f"{array}_1") == 1, "not requeued")
    allow_all(tmp_path)
    for task in (0, 1):
        slurm.wait(lambda task=task: slurm.has_ended(f"{array}_{task}"), "does not end")
        assert slurm.state(f"{array}_{task}") == "COMPLETED"
    assert legs(tmp_path / "one.h5") == [0]
    assert legs(tmp_path / "two.h5") == [75, 0]
    assert_same(tmp_path / "two.h5", decisions(tmp_path / "one.h5"))


def test_a_job_that_is_sent_no_signal_stops_itself_a_minute_before_its_end(slurm, limited):
    folder, job = limited
    slurm.wait(lambda: slurm.restarts(job) >= 1, "not requeued")
    slurm("scancel", job)
    slurm.wait(lambda: slurm.has_ended(job), "does not end")
    assert legs(folder / "long.h5")[0] == 75
    assert "stopped: the walltime limit is reached" in said(folder, job)
    assert_sound(folder / "long.h5")
