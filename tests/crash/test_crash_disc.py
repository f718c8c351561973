"""Discs that are full or read-only, and files that are cut short or taken away."""

import os
import subprocess

import pytest
from campaign_runs import (
    SMALL,
    TINY,
    assert_same,
    assert_sound,
    decisions,
    finish,
    injected,
    invert,
    need_mpirun,
    running,
    samples_in,
    state,
    wait_until,
    write_campaign,
)
from crash_rows import final_rows
from held_runs import allow, allow_all, held
from processes import HANG, output_of


@pytest.fixture
def disc(tmp_path):
    """Return a small disc of its own with the small campaign, and how to change its options."""
    folder = tmp_path / "disc"
    folder.mkdir()

    def mount(options):
        words = ["mount", "-t", "tmpfs", "-o", options, "tmpfs", str(folder)]
        return subprocess.run(words, capture_output=True, text=True, timeout=HANG, check=False)

    done = mount("size=256k")
    if done.returncode:
        if os.environ.get("CI"):
            pytest.fail(f"no disc can be mounted: {done.stderr}")
        pytest.skip("mounting a small disc needs a superuser")
    write_campaign(folder / "small.yaml", **SMALL)
    yield folder, lambda options: mount(f"remount,{options}")
    subprocess.run(["umount", "--lazy", str(folder)], timeout=HANG, check=True)


@pytest.mark.parametrize("ranks", [None, pytest.param(2, marks=pytest.mark.slow)])
def test_a_full_disc_is_one_message_and_more_room_is_enough_to_go_on(disc, wanted, ranks):
    if ranks is not None:
        need_mpirun()
    folder, remount = disc
    with open(folder / "ballast", "wb") as file:
        file.write(bytes(80_000))
    done = invert(folder, "small.yaml", ranks=ranks)
    assert done.returncode == 1, done.stderr
    kept = "everything written before is whole, run again to go on"
    assert f"small.h5: No space left on device; {kept}\n" in done.stderr
    assert "Traceback" not in done.stderr
    rows = final_rows(folder / "small.h5")
    assert any(table == "samples" for table, _ in rows)
    assert_sound(folder / "small.h5")
    remount("size=20m")
    finish(folder, "small.yaml", ranks=ranks)
    now = final_rows(folder / "small.h5")
    assert [key for key, row in rows.items() if now[key] != row] == []
    assert_same(folder / "small.h5", wanted)


def test_a_disc_without_room_for_the_file_keeps_none(disc):
    folder, _ = disc
    with open(folder / "ballast", "wb", buffering=0) as file:
        try:
            while file.write(bytes(4096)):
                pass
        except OSError:
            pass
    done = invert(folder, "small.yaml")
    assert (done.returncode, done.stdout) == (2, "")
    assert done.stderr.endswith("No space left on device\n")
    assert done.stderr.count("\n") == 1
    assert {path.name for path in folder.glob("*h5*")} <= {".small.h5.lock"}


def test_a_read_only_disc_is_one_message(disc):
    folder, remount = disc
    remount("ro")
    done = invert(folder, "small.yaml")
    assert (done.returncode, done.stdout) == (2, "")
    assert done.stderr.endswith("cannot be written\n")
    assert done.stderr.count("\n") == 1


TAKEN_AWAY = """
import os
from agglom_mpi.search.inversion import Inversion

complete_all = Inversion.complete_all

def taken(*arguments, **options):
    if os.path.exists("long.h5"):
        os.remove("long.h5")
    return complete_all(*arguments, **options)

Inversion.complete_all = taken
"""


def test_a_file_that_is_taken_away_is_noticed_in_a_plain_run(tmp_path):
    write_campaign(tmp_path / "long.yaml", **TINY | {"generations": 9})
    with injected(TAKEN_AWAY, "agglom_mpi.search.inversion.Inversion.complete_all"):
        done = invert(tmp_path, "long.yaml")
    assert done.returncode == 1
    assert "long.h5: was removed or replaced while it was being written; it is lost\n" in (
        done.stderr
    )
    assert not (tmp_path / "long.h5").exists()


@pytest.mark.slow(guard="crash/test_crash_disc.py")
def test_a_file_that_is_taken_away_is_noticed(tmp_path):
    need_mpirun()
    path = write_campaign(tmp_path / "long.yaml", **SMALL | {"generations": 9}).with_suffix(".h5")
    allow(tmp_path, 20)
    with running(tmp_path, "long.yaml", ranks=2, inject=held(tmp_path)) as process:
        wait_until(lambda: samples_in(path) > 0, process)
        os.remove(path)
        allow(tmp_path, 600)  # to the end of a generation, when it is noticed
        _, said = output_of(process)
    assert process.returncode == 1
    assert "long.h5: was removed or replaced while it was being written; it is lost\n" in said
    assert "Traceback" not in said
    assert not path.exists()


def test_a_file_cut_short_is_refused_and_left_as_it_is(undisturbed, folder):
    path = folder / "small.h5"
    content = (undisturbed / "small.h5").read_bytes()
    path.write_bytes(content[: len(content) // 2])
    done = invert(folder, "small.yaml")
    assert (done.returncode, done.stdout) == (1, "")
    assert done.stderr == "small.h5: a truncated HDF5 file\n"
    assert path.read_bytes() == content[: len(content) // 2]
    finish(folder, "small.yaml", "--output", "fresh.h5")
    assert_same(folder / "fresh.h5", decisions(undisturbed / "small.h5"))
    assert state(folder / "fresh.h5")[0] == "finished"


@pytest.mark.slow(
    guard="crash/test_crash_disc.py::test_a_file_that_is_taken_away_is_noticed_in_a_plain_run"
)
def test_a_file_that_is_truncated_meanwhile_is_noticed(tmp_path):
    path = write_campaign(tmp_path / "long.yaml", **SMALL | {"generations": 9}).with_suffix(".h5")
    allow(tmp_path, 20)
    with running(tmp_path, "long.yaml", "--quiet", inject=held(tmp_path)) as process:
        wait_until(lambda: samples_in(path) > 0, process)
        os.truncate(path, 3000)
        allow_all(tmp_path)
        _, said = output_of(process)
    assert process.returncode == 1
    assert "long.h5: was truncated or overwritten" in said
    assert "Traceback" not in said
    assert path.stat().st_size == 3000
