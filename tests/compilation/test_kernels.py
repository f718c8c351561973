"""Where compiled kernels are kept, and what they may fuse."""

import os
import tempfile
from pathlib import Path

import numba
import pytest

from agglom_mpi.compilation import kernels
from agglom_mpi.compilation.kernels import cache_folder, fused, runs_compiled, sources_digest

KEY = sources_digest()[:16]
find_folder = cache_folder.__wrapped__
NOBODY = 65534


@pytest.fixture
def folders(monkeypatch):
    """Return a chosen parent that may be read only and a temporary directory, as nobody."""
    with tempfile.TemporaryDirectory(dir="/tmp") as parent:  # every user may go there
        chosen, temporary = Path(parent, "chosen"), Path(parent, "temporary")
        (chosen / KEY / "simulation").mkdir(parents=True)
        temporary.mkdir()
        (chosen / KEY / "simulation" / "kernel.nbc").write_bytes(b"machine code")
        temporary.chmod(0o777)
        Path(parent).chmod(0o755)
        (chosen / KEY).chmod(0o555)
        monkeypatch.setenv("NUMBA_CACHE_DIR", str(chosen))
        monkeypatch.setattr(tempfile, "tempdir", str(temporary))
        root = os.geteuid() == 0
        if root:
            os.seteuid(NOBODY)
        yield chosen, temporary
        if root:
            os.seteuid(0)
        (chosen / KEY).chmod(0o755)


def test_what_was_compiled_into_a_read_only_folder_is_used(folders):
    chosen, temporary = folders
    assert not os.access(chosen / KEY, os.W_OK, effective_ids=True)
    found = find_folder()
    assert found.parent.parent == temporary
    assert (found / "simulation" / "kernel.nbc").read_bytes() == b"machine code"
    (found / "simulation" / "more.nbc").write_bytes(b"later")
    assert find_folder() == found
    assert (found / "simulation" / "more.nbc").exists()


@pytest.fixture
def temporary(tmp_path, monkeypatch):
    """Return a chosen folder with a kernel, and the temporary directory beside it."""
    chosen, temporary = tmp_path / "chosen", tmp_path / "temporary"
    (chosen / KEY).mkdir(parents=True)
    temporary.mkdir()
    (chosen / KEY / "planted.nbi").write_bytes(b"not ours")
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(chosen))
    monkeypatch.setattr(tempfile, "tempdir", str(temporary))
    return chosen, temporary


@pytest.mark.parametrize("shared", [".", KEY])
def test_a_folder_where_any_user_can_write_is_not_used(temporary, shared):
    chosen, other = temporary
    (chosen / shared).chmod(0o777)
    found = find_folder()
    assert found == other / f"agglom_mpi-{os.getuid()}" / KEY
    assert not list(found.iterdir())
    assert found.parent.stat().st_mode & 0o777 == 0o700


@pytest.mark.skipif(os.geteuid() != 0, reason="root alone can give a folder to another user")
def test_a_folder_of_another_user_in_a_folder_of_all_is_not_used(temporary):
    chosen, other = temporary
    chosen.parent.chmod(0o1777)
    assert find_folder() == chosen / KEY
    os.chown(chosen, NOBODY, NOBODY)
    assert find_folder().is_relative_to(other)


@pytest.mark.parametrize("planted", ["open", "link", "file"])
def test_a_planted_folder_in_the_temporary_directory_is_not_used(temporary, monkeypatch, planted):
    chosen, other = temporary
    monkeypatch.delenv("NUMBA_CACHE_DIR")
    monkeypatch.setenv("XDG_CACHE_HOME", str(chosen / KEY / "planted.nbi"))  # no folder
    place = other / f"agglom_mpi-{os.getuid()}"
    match planted:
        case "open":
            place.mkdir()
            place.chmod(0o770)
        case "link":
            place.symlink_to(chosen)
        case "file":
            place.write_text("")
    found = find_folder()
    assert found.is_relative_to(other)
    assert not found.is_relative_to(place)
    assert found.parent.stat().st_mode & 0o777 == 0o700


def test_without_a_home_kernels_are_kept_in_the_temporary_directory(temporary, monkeypatch):
    for name in ("NUMBA_CACHE_DIR", "XDG_CACHE_HOME", "HOME"):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setattr(kernels.Path, "expanduser", no_home)
    assert find_folder() == temporary[1] / f"agglom_mpi-{os.getuid()}" / KEY


def no_home(path):
    raise RuntimeError("Could not determine home directory.")


def test_a_folder_that_can_be_written_is_used_as_it_is(tmp_path, monkeypatch):
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path / "kernels"))
    assert find_folder() == tmp_path / "kernels" / KEY
    assert find_folder().is_dir()


@pytest.mark.skipif(not runs_compiled(), reason="plain Python rounds twice")
def test_a_fused_sum_is_rounded_once():
    @numba.njit
    def sums(a, b, c):
        return fused(a, b, c), a * b + c

    a = 1.0 + 2.0**-30
    assert sums(a, a, -(1.0 + 2.0**-29)) == (2.0**-60, 0.0)
