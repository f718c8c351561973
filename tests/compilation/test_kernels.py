"""Where compiled kernels are kept, and what they may fuse."""

import os
import tempfile
from pathlib import Path

import numba
import pytest

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
        for path in (temporary, Path(parent)):
            path.chmod(0o777)
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
