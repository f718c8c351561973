import os
import tempfile

import pytest
from attacked_commands import Commands

from agglom_mpi.compilation.kernels import cache_folder


@pytest.fixture(scope="session")
def tiny_folder(shared_campaign):
    """Return a folder with a tiny campaign and its file."""
    return shared_campaign("tiny")


@pytest.fixture
def cases(request):
    """Return a function that gives the number of cases, unless `--many` asks for another."""
    return lambda usual: request.config.getoption("--many") or usual


def contents(folder):
    """Return the names below a folder with what changes when they are touched."""
    found = {}
    for place, folders, files in os.walk(folder):
        for name in [*folders, *files]:
            path = os.path.join(place, name)
            status = os.lstat(path)
            found[path] = status.st_mtime_ns, status.st_size, status.st_mode
    return found


@pytest.fixture
def commands(tmp_path, monkeypatch):
    """Return commands that run in a working folder; nothing outside it may be touched."""
    for name in ("home", "temporary", "neighbour", "work"):
        (tmp_path / name).mkdir()
    (tmp_path / "neighbour" / "notes.txt").write_text("mine")
    monkeypatch.chdir(tmp_path / "work")
    made = Commands(tmp_path / "work")
    cache_folder()  # compiled kernels are those of the real home, whichever test comes first
    monkeypatch.setenv("HOME", str(tmp_path / "home"))
    monkeypatch.setenv("TMPDIR", str(tmp_path / "temporary"))
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path / "temporary"))
    outside = {name: contents(tmp_path / name) for name in ("home", "temporary", "neighbour")}
    yield made
    assert {name: contents(tmp_path / name) for name in outside} == outside
    assert {path.name for path in tmp_path.iterdir()} == {*outside, "work"}
