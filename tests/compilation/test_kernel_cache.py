"""Files of compiled kernels that cannot be read: dropped, compiled again, reported in one line."""

import logging
import os
import pickle

import numba
import pytest

from agglom_mpi.compilation import kernel_cache, kernels
from agglom_mpi.compilation.kernel_cache import CheckedFiles
from agglom_mpi.compilation.kernels import kernel, runs_compiled

COMPILED = pytest.mark.skipif(not runs_compiled(), reason="nothing is compiled")


def replace_by(make):
    """Return a function that puts something else in place of a file."""

    def replaced(path):
        path.unlink()
        make(path)

    return replaced


def flip(path):
    content = bytearray(path.read_bytes())
    content[len(content) // 2] ^= 1
    path.write_bytes(content)


def make_sparse(path):
    with path.open("wb") as file:
        file.truncate(2 * kernel_cache.MAX_BYTES)


DAMAGE = {
    "no bytes": lambda path: path.write_bytes(b""),
    "a first half": lambda path: path.write_bytes(path.read_bytes()[: path.stat().st_size // 2]),
    "one bit": flip,
    "more": lambda path: path.write_bytes(path.read_bytes() + b"\0"),
    "zeros": lambda path: path.write_bytes(bytes(path.stat().st_size)),
    "another pickle": lambda path: path.write_bytes(pickle.dumps("0.68.1")),
    "a folder": replace_by(lambda path: path.mkdir()),
    "a pipe": replace_by(os.mkfifo),
    "a link to itself": replace_by(lambda path: path.symlink_to(path)),
    "too large": make_sparse,
}
ABSENT = {
    "nothing": lambda path: path.unlink(),
    "a link to nothing": replace_by(lambda path: path.symlink_to("nothing")),
}


@pytest.fixture
def files(tmp_path):
    """Return the files of a kernel with two entries."""
    files = CheckedFiles(tmp_path, "kernel-1.py", "stamp")
    files.save("A", [1.0])
    files.save("B", [2.0])
    return files


def data_of(files, key):
    [path] = [path for path in files.folder.glob("*.nbc") if pickle.loads(path.read_bytes()) == key]
    return path


@pytest.mark.parametrize("damage", DAMAGE)
def test_an_index_that_cannot_be_read_is_an_error_and_dropped_with_what_it_names(files, damage):
    DAMAGE[damage](files.index)
    with pytest.raises((OSError, ValueError)):
        files.load("A")
    assert files.drop("A") == files.index
    assert list(files.folder.iterdir()) == []
    assert files.load("A") is None
    files.save("A", [3.0])
    assert files.load("A") == [3.0]


@pytest.mark.parametrize("damage", DAMAGE)
def test_data_that_cannot_be_read_are_dropped_alone(files, damage):
    path = data_of(files, [1.0])
    DAMAGE[damage](path)
    with pytest.raises((OSError, ValueError)):
        files.load("A")
    assert files.drop("A") == path
    assert files.load("A") is None
    assert files.load("B") == [2.0]
    files.save("A", [1.0])
    assert [files.load(key) for key in "AB"] == [[1.0], [2.0]]


@pytest.mark.parametrize("damage", ABSENT)
def test_what_is_absent_is_a_miss_without_an_error(files, damage):
    ABSENT[damage](data_of(files, [1.0]))
    assert files.load("A") is None
    assert files.load("B") == [2.0]
    ABSENT[damage](files.index)
    assert files.load("B") is None
    files.save("A", [1.0])
    assert files.load("A") == [1.0]


def test_data_of_another_kernel_are_never_taken(files):
    """As where a copy was killed, or two processes have written at once."""
    one, two = data_of(files, [1.0]), data_of(files, [2.0])
    content = one.read_bytes()
    one.write_bytes(two.read_bytes())
    two.write_bytes(content)
    for key in "AB":
        with pytest.raises(ValueError, match="altered or cut short"):
            files.load(key)


def test_an_index_is_written_over_one_that_cannot_be_read(files):
    files.index.write_bytes(b"")
    files.save("C", [3.0])
    assert [files.load(key) for key in "ABC"] == [None, None, [3.0]]


def test_what_another_source_has_left_is_no_damage_and_not_used(files):
    other = CheckedFiles(files.folder, "kernel-1.py", "later")
    assert other.load("A") is None
    other.save("A", [4.0])
    assert other.load("A") == [4.0]
    assert files.load("A") is None


def test_a_write_that_fails_leaves_nothing_behind(files, monkeypatch):
    before = sorted(files.folder.iterdir())

    def full(self, target):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(type(files.folder), "replace", full)
    with pytest.raises(OSError, match="No space left"):
        files.save("C", [3.0])
    assert sorted(files.folder.iterdir()) == before


def doubled(x):
    return 2.0 * x


@pytest.fixture
def load(tmp_path, monkeypatch, caplog):
    """Return a function that loads a kernel as a new process does.

    It returns the numbers of hits and misses, and the lines that were logged.
    """
    monkeypatch.setattr(kernels, "cache_folder", lambda: tmp_path)
    monkeypatch.setattr(numba.config, "CACHE_DIR", numba.config.CACHE_DIR)

    def loaded():
        monkeypatch.setattr(kernel_cache, "_REPORTED", set())
        caplog.clear()
        with caplog.at_level(logging.WARNING, "agglom_mpi"):
            compiled = kernel(doubled)
            assert compiled(1.5) == 3.0
        lines = [record.getMessage() for record in caplog.records]
        return len(compiled.stats.cache_hits), len(compiled.stats.cache_misses), lines

    return loaded


@COMPILED
@pytest.mark.parametrize("suffix", [".nbi", ".nbc"])
def test_a_kernel_whose_file_is_damaged_is_compiled_again_and_said_once(load, tmp_path, suffix):
    assert load() == (0, 1, [])
    assert load() == (1, 0, [])
    [path] = tmp_path.rglob(f"*{suffix}")
    path.write_bytes(b"")
    hits, misses, [line] = load()
    assert (hits, misses) == (0, 1)
    assert line.startswith("warning: ")
    assert str(path.parent) in line
    assert path.name in line
    assert load() == (1, 0, [])


@COMPILED
def test_machine_code_that_does_not_load_is_compiled_again(load, tmp_path, monkeypatch):
    load()
    with monkeypatch.context() as patch:

        def rebuild(*arguments):
            raise EOFError

        patch.setattr(kernel_cache.CompileResultCacheImpl, "rebuild", rebuild)
        hits, misses, [line] = load()
    assert (hits, misses) == (0, 1)
    assert "(EOFError)" in line
    assert load() == (1, 0, [])


@COMPILED
def test_a_kernel_that_cannot_be_written_runs(load, tmp_path, monkeypatch):
    with monkeypatch.context() as patch:

        def full(path, content):
            raise OSError(28, "No space left on device")

        patch.setattr(kernel_cache, "_write", full)
        hits, misses, [line] = load()
    assert (hits, misses) == (0, 1)
    assert "No space left on device" in line
    assert not list(tmp_path.rglob("*.nb[ic]"))


@COMPILED
def test_a_kernel_without_a_folder_runs_and_is_kept_nowhere_else(load, tmp_path):
    load()
    [folder] = [path for path in tmp_path.iterdir() if path.is_dir()]
    for path in folder.iterdir():
        path.unlink()
    folder.rmdir()
    folder.write_text("no folder")
    hits, misses, [line] = load()
    assert (hits, misses) == (0, 1)
    assert str(tmp_path) in line
    assert not list(tmp_path.rglob("*.nb[ic]"))
