"""Control characters in names, texts and options do not reach the terminal, whoever wrote them."""

import re
import shutil
import sys
from pathlib import Path

import h5py
import pytest
from campaign_runs import environment
from processes import output_of, program

from agglom_mpi.display.run_display import Display, print_wide
from agglom_mpi.storage.reader import read_campaign
from agglom_mpi.storage.writer import CampaignWriter

BIN = Path(sys.executable).parent
HOSTILE = "\x1b]0;owned\x07\x1b[2J\x9b31m\u202e\u200fx"
COMMANDS = re.compile("[\x00-\x08\x0b-\x1f\x7f-\x9f\u200e\u200f\u202a-\u202e\u2066-\u2069]")


@pytest.fixture
def named(tiny_folder, tmp_path):
    """Return a folder with a campaign and a file whose names would command a terminal."""
    for suffix in (".yaml", ".h5"):
        shutil.copy(tiny_folder / f"tiny{suffix}", tmp_path / f"{HOSTILE}{suffix}")
    text = (tmp_path / f"{HOSTILE}.yaml").read_text()
    untitled = "".join(line for line in text.splitlines(True) if not line.startswith("title"))
    (tmp_path / f"{HOSTILE}.yaml").write_text(untitled)
    return tmp_path


SLOW = pytest.mark.slow
LINES = [
    ["agglom", "check", f"{HOSTILE}.yaml"],
    ["agglom", "report", f"{HOSTILE}.h5"],
    ["agglom", "check", f"{HOSTILE}.h5"],
    ["agglom", "export", f"{HOSTILE}.h5", "--csv", HOSTILE],
    ["agglom", "report", "--" + HOSTILE],
    ["agglom", "simulate", f"{HOSTILE}.yaml", "--set", f"{HOSTILE}=1"],
    ["agglom", "simulate", f"{HOSTILE}.yaml", "--set", HOSTILE],
    ["agglom", "simulate", f"{HOSTILE}.yaml", "--engine", HOSTILE],
    ["agglom", HOSTILE],
    ["agglom-invert", f"{HOSTILE}.yaml", "--generations", HOSTILE],
    ["agglom-invert", f"{HOSTILE}.yaml", "--output", "other.h5"],
]


@pytest.mark.parametrize(
    "words", [pytest.param(line, marks=SLOW) if i != 1 else line for i, line in enumerate(LINES)]
)
def test_no_control_character_of_a_name_or_an_option_is_printed(named, words):
    with program([BIN / words[0], *words[1:]], cwd=named, env=environment()) as process:
        said, errors = output_of(process)
    assert "owned" in said + errors
    assert not COMMANDS.search(said + errors)
    assert "Traceback" not in errors


def test_texts_of_a_file_do_not_command_the_terminal(tiny_folder, tmp_path, agglom):
    path = tmp_path / "altered.h5"
    shutil.copy(tiny_folder / "tiny.h5", path)
    with h5py.File(path, "r+") as file:
        for name in ("title", "code_version", "created", "purpose", "format"):
            file.attrs[name] = HOSTILE
    for options in (
        ["report"],
        ["report", "--json"],
        ["check"],
        ["export", "--csv", tmp_path / "c"],
    ):
        shown = agglom(options[0], path, *options[1:])
        assert not COMMANDS.search(shown.output)


def test_messages_and_tables_of_a_run_are_printable_and_keep_their_styles(capsys, monkeypatch):
    monkeypatch.setenv("FORCE_COLOR", "1")
    display = Display()
    display.message(f"message {HOSTILE}")
    display.error(f"error {HOSTILE}")
    print_wide(f"table {HOSTILE}")
    said, errors = capsys.readouterr()
    assert "\x1b[1;31merror " in errors
    assert all("owned" in line for line in (said + errors).splitlines())
    own = re.sub(r"\x1b\[[0-9;]*m", "", said + errors)
    assert not COMMANDS.search(own)


def test_texts_of_a_file_neither_turn_nor_hide_others_on_the_page(tiny_folder, tmp_path):
    pytest.importorskip("matplotlib")
    pytest.importorskip("jinja2")
    from agglom_mpi.report.figures.figure import FigureOptions
    from agglom_mpi.report.page import render
    from agglom_mpi.report.sections.section import Page

    path = tmp_path / f"{HOSTILE}.h5"
    shutil.copy(tiny_folder / "tiny.h5", path)
    with h5py.File(path, "r+") as file:
        for name in ("title", "code_version"):
            file.attrs[name] = HOSTILE
        file.attrs["campaign"] = f"# {HOSTILE}\n{file.attrs['campaign']}"
    with CampaignWriter(path) as writer:
        writer.log.put_failure(0, 0, rank=0, host="node", text=f"ValueError: {HOSTILE}")
        writer.set_status("failed", HOSTILE)
    page = render(Page(read_campaign(path), tmp_path, FigureOptions(seconds=0.0)))
    assert page.count("owned") >= 5
    assert not COMMANDS.search(page)


def test_a_title_and_a_purpose_of_a_megabyte_are_cut(tiny_folder, tmp_path, agglom):
    path = tmp_path / "long.h5"
    shutil.copy(tiny_folder / "tiny.h5", path)
    with h5py.File(path, "r+") as file:
        file.attrs["title"] = "t" * 60000
    assert len(agglom("report", path).output) < 6000
    with h5py.File(path, "r+") as file:
        file.attrs["purpose"] = "p" * 60000
    done = agglom("report", path)
    assert done.exit_code == 2
    assert len(done.output) < 1000
    long = (tiny_folder / "tiny.yaml").read_text()
    long = re.sub("(?m)^title: .*$", f"title: {'t' * 10**6}", long)
    (tmp_path / "long.yaml").write_text(long)
    assert len(agglom("check", tmp_path / "long.yaml").output) < 10000
