"""Limits that hold on every way in, and files that never end."""

import os
import socket
from pathlib import Path

import pytest

from agglom_mpi import load_campaign
from agglom_mpi.config.user_function import read_function
from agglom_mpi.config.yaml_source import MAX_BYTES, CampaignError, read_text
from agglom_mpi.file_kinds import is_hdf5
from agglom_mpi.storage.access import NotACampaign, open_file


@pytest.mark.parametrize("value", ["9" * 5000, "1" + 30 * "0", "nan", "inf"])
@pytest.mark.parametrize(
    ("option", "allowed"), [("--ranks", "numbers from 1 to 1000000"), ("--seconds", "90s, 30m")]
)
def test_a_plan_has_limits_however_they_are_written(agglom, option, allowed, value):
    done = agglom("plan", "tiny.yaml", option, value)
    assert done.exit_code == 2
    assert f"allowed: {allowed}" in done.stderr.replace("90, ", "")


@pytest.mark.parametrize(
    "words",
    [
        ["simulate", "tiny.yaml", "--samples", "10000000000000000000000"],
        ["simulate", "tiny.yaml", "--frames", "99999999999999"],
        ["export", "tiny.h5", "--paraview", "x.vtkhdf", "--frames", "99999999999999"],
    ],
)
def test_a_number_beyond_its_limit_is_bad_input(agglom, words):
    done = agglom(*words)
    assert done.exit_code == 2
    assert "is not in the range" in done.stderr


def test_generations_have_the_limit_of_the_campaign_file(tiny_folder):
    from click.testing import CliRunner

    from agglom_mpi.cli.invert import invert_command

    words = [str(tiny_folder / "tiny.yaml"), "--generations", "99999999999999"]
    done = CliRunner().invoke(invert_command, words)
    assert done.exit_code == 2
    assert "is not in the range 1<=x<=1000000" in done.stderr


def special(tmp_path, kind):
    """Make something that is no regular file; its path."""
    path = tmp_path / "campaign.yaml"
    if kind == "pipe":
        os.mkfifo(path)
    elif kind == "device":
        path.symlink_to("/dev/zero")
    elif kind == "directory":
        path.mkdir()
    else:
        with socket.socket(socket.AF_UNIX) as opened:
            opened.bind(path.name)
    return path


@pytest.mark.parametrize("kind", ["pipe", "device", "directory", "socket"])
def test_only_a_regular_file_is_a_campaign(tmp_path, monkeypatch, kind):
    monkeypatch.chdir(tmp_path)
    with pytest.raises(CampaignError, match=r"is not a regular file|is a directory"):
        read_text(str(special(tmp_path, kind)))


@pytest.mark.parametrize("name", ["/proc/self/environ", "/proc/sys/kernel/ostype"])
def test_files_of_the_kernel_are_not_read(tmp_path, monkeypatch, name):
    """Some of them, as /proc/kmsg, block whoever reads them."""

    def never(*arguments):
        raise AssertionError("the file was opened")

    linked = tmp_path / "linked.py"
    linked.symlink_to(name)
    monkeypatch.setattr(Path, "open", never)
    for path in (name, str(linked)):
        assert not is_hdf5(path)
        with pytest.raises(CampaignError, match=r"is in /proc or /sys, which are not read"):
            read_text(path)
        with pytest.raises(NotACampaign):
            open_file(Path(path))
    with pytest.raises(ValueError, match=r"is in /proc or /sys, which are not read"):
        read_function(tmp_path, "linked:worth")


def test_a_link_in_proc_to_another_file_is_read(tmp_path):
    path = tmp_path / "campaign.yaml"
    path.write_text("seed: 1\n")
    with path.open() as file:
        assert read_text(f"/proc/self/fd/{file.fileno()}") == "seed: 1\n"


def test_a_file_that_is_no_campaign_is_not_quoted(tmp_path):
    path = tmp_path / "tokens.yaml"
    path.write_text("a-secret-of-somebody: another-secret\n")
    with pytest.raises(CampaignError) as caught:
        load_campaign(path)
    assert "holds none of the sections of a campaign" in str(caught.value)
    assert "secret" not in str(caught.value)


def test_a_module_that_is_no_python_is_hardly_quoted(tmp_path):
    (tmp_path / "own.py").write_text("# coding: a-very-long-secret-of-somebody\n")
    with pytest.raises(ValueError, match=r"own\.py") as caught:
        read_function(tmp_path, "own:worth")
    assert "long-secret-of-somebody" not in str(caught.value)


def test_a_large_file_is_refused_by_its_size(tmp_path):
    path = tmp_path / "large.yaml"
    with path.open("wb") as file:
        file.truncate(MAX_BYTES + 1)
    with pytest.raises(CampaignError, match="is larger than 1 MiB"):
        read_text(str(path))


def test_a_pipe_that_gives_too_much_is_refused(tmp_path, piped):
    assert read_text(piped("seed: 1\n")) == "seed: 1\n"
    reading, writing = os.pipe()
    if os.fork() == 0:
        os.close(reading)
        try:
            while True:
                os.write(writing, bytes(1 << 16))
        finally:
            os._exit(0)
    os.close(writing)
    try:
        with pytest.raises(CampaignError, match="is larger than 1 MiB"):
            read_text(f"/dev/fd/{reading}")
    finally:
        os.close(reading)
        os.wait()


def test_a_module_that_never_ends_or_is_nested_deeply_is_refused(tmp_path):
    (tmp_path / "zero.py").symlink_to("/dev/zero")
    with pytest.raises(ValueError, match="is not a regular file"):
        read_function(tmp_path, "zero:worth")
    (tmp_path / "deep.py").write_text("worth = " + "-" * 200_000 + "1\n")
    with pytest.raises(ValueError, match=r"deep\.py"):
        read_function(tmp_path, "deep:worth")
