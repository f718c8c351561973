import os

import pytest
from click.testing import CliRunner


@pytest.fixture(scope="session")
def tiny_folder(shared_campaign):
    """Return a folder with a tiny campaign and its file."""
    return shared_campaign("tiny")


@pytest.fixture
def agglom(tiny_folder, monkeypatch):
    """Return a function that runs `agglom` in that folder, in this process."""
    from agglom_mpi.cli import main

    def run(*arguments):
        result = CliRunner().invoke(main, [str(argument) for argument in arguments])
        assert result.exception is None or isinstance(result.exception, SystemExit), result.exc_info
        return result

    monkeypatch.chdir(tiny_folder)
    return run


@pytest.fixture
def remembered(monkeypatch):
    """Let sets and posteriors of the same file be computed once for all tests."""
    from known_sets import remember_sets

    remember_sets(monkeypatch)


@pytest.fixture
def mistaken(agglom):
    """Return a function that runs `agglom` and expects a mistake in one line."""

    def run(*arguments, code=2):
        result = agglom(*arguments)
        assert result.exit_code == code, result.output
        assert result.stdout == ""
        assert result.stderr.count("\n") == 1
        return result.stderr.rstrip("\n")

    return run


@pytest.fixture
def piped():
    """Return a function that gives the name of a pipe with a text, as a shell's `<(...)`."""
    ends = []

    def name(text):
        reading, writing = os.pipe()
        ends.append(reading)
        with os.fdopen(writing, "w") as pipe:
            pipe.write(text)
        return f"/dev/fd/{reading}"

    yield name
    for end in ends:
        os.close(end)
