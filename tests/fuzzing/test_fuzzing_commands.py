"""Command lines with the options of every command, and values that nobody would give.

What takes long is left out by construction: everything up to the first sample, figure or other
process is as it is, and there stands an error instead.
"""

import shutil

import click
import pytest
from attacked_commands import PHASES
from hypothesis import given, settings
from hypothesis import strategies as st

from agglom_mpi.cli import main
from agglom_mpi.cli.invert import invert_command
from agglom_mpi.errors import FAILURE, FINISHED, UserError

WORK = [
    "agglom_mpi.verbs.simulate.simulate",
    "agglom_mpi.cli.doctor.run_checks",
    "agglom_mpi.planning.pilot.run_pilot",
    "agglom_mpi.planning.plan.read_recorded_samples",
    "agglom_mpi.report.page.write_report",
    "agglom_mpi.report.paraview.write_samples",
    "agglom_mpi.runtime.run.prepare",
    "agglom_mpi.simulation.compilation.compile_kernels",
]
"""Where work begins."""


class WorkBeginsError(UserError):
    """The command line was understood, and all that it names was read."""

    exit_code = FAILURE


def begin(*arguments, **options):
    """Do no work."""
    raise WorkBeginsError("work begins")


def options_of(command):
    """Return the options of a command with whether each takes a value."""
    found = [option for option in command.params if isinstance(option, click.Option)]
    return [(name, not option.is_flag) for option in found for name in option.opts]


def commands():
    """Return the words that call each command, and its options."""
    context = click.Context(main)
    found = [main.resolve_command(context, [name])[:2] for name in sorted(main.commands)]
    called = [(["agglom", name], options_of(command)) for name, command in found]
    return [*called, (["agglom-invert"], options_of(invert_command)), (["agglom"], [])]


PATHS = [
    *(
        "tiny.yaml",
        "tiny.h5",
        "broken.h5",
        "text.h5",
        "missing.yaml",
        ".",
        "folder",
        "folder/x",
        "-",
    ),
    *("/dev/null", "/dev/null/x", "/proc/self/mem", "/proc/self/environ", "x" * 300, "x/" * 3000),
    *("a\nb.h5", "\x1b]0;owned\x07.yaml", "\udcff.h5", "é.h5", " ", "", "~", "$HOME", "a.vtkhdf"),
    *("/dev/fd/77", "loop", "tiny.h5/x", "--", "[red]x", ":smile:", "%s%n", "out.h5"),
]
"""No name leads out of the working folder but to what only the system has."""
NUMBERS = [
    *(
        "0",
        "1",
        "-1",
        "2",
        "1e3",
        "9" * 30,
        "9" * 5000,
        "nan",
        "inf",
        "-inf",
        "1e400",
        "0x10",
        "１",
    ),
    *(
        "",
        " ",
        "1,2",
        "1,,2",
        ",",
        "1:2:3",
        "1-0",
        "::",
        "2h",
        "1e300h",
        "1" * 400 + "-0",
        "٣",
        "1_0",
    ),
]
SETTINGS = [
    *("density=6000", "density=", "=", "=1", "density", "density=nan", "density=1e400", "x=1"),
    *("density=10 MPa", "hardness=67 MPa", "hardness=1 " + "m*" * 300 + "m", "density=\x1b[2J"),
    *("\x1b[2J=1", "size_ratio=99", "friction=-1", "temperature=0 degC", "density=1 m**9**9"),
    *("hardness=" + "9" * 5000, "d" * 5000 + "=1", "hardness=1 9**9**9**9", "density=\udcff"),
]
ENGINES = ["event", "fixed", "fixed:0", "fixed:-1", "fixed:" + "9" * 5000, "adaptive:x", "\x1b[2J"]
WORDS = [
    "--help",
    "--version",
    "--",
    "-",
    "-q",
    "-qq",
    "--no-such",
    "--out=",
    "--json=1",
    "-o",
    "\x1b",
]
ARGUMENT = st.characters(codec="utf-8", exclude_characters="\0")
"""Of what the system passes on to a program."""
VALUES = st.one_of(*map(st.sampled_from, (PATHS, NUMBERS, SETTINGS, ENGINES))) | st.text(
    ARGUMENT, max_size=9
)
COMMANDS = commands()


@st.composite
def command_lines(draw):
    """Draw a command line, its options with values that may be those of others."""
    called, options = draw(st.sampled_from(COMMANDS))
    words = [draw(st.sampled_from(PATHS[:9] * 3 + PATHS)) for _ in range(draw(st.integers(0, 2)))]
    for _ in range(draw(st.integers(0, 4)) if options else 0):
        name, takes_value = draw(st.sampled_from(options))
        words += [name, draw(VALUES)] if takes_value else [name]
    if draw(st.integers(0, 5)) == 0:
        words.insert(draw(st.integers(0, len(words))), draw(st.sampled_from(WORDS)))
    return [*called, *words]


@pytest.fixture
def work(commands, tiny_folder, monkeypatch):
    """Return commands with files to read, everything that they need loaded."""
    folder = commands.folder
    for name in ("tiny.yaml", "tiny.h5"):
        shutil.copy(tiny_folder / name, folder)
    (folder / "broken.h5").write_bytes((tiny_folder / "tiny.h5").read_bytes()[:5000])
    (folder / "text.h5").write_text("no HDF5")
    (folder / "folder").mkdir()
    (folder / "loop").symlink_to("loop")
    for place in WORK:
        monkeypatch.setattr(place, begin)
    commands.load("agglom", "report", "tiny.h5", "tiny.h5", "--json")
    commands.load("agglom", "report", "tiny.h5", "--sensitivity")
    commands.run("agglom", "simulate", "tiny.yaml", "--set", "hardness=67 MPa")
    return commands


@pytest.mark.slow
def test_a_mutated_command_line_is_understood_or_refused_in_words(work, cases):
    kept = {name: (work.folder / name).read_bytes() for name in ("tiny.yaml", "tiny.h5")}
    codes = set()

    @settings(max_examples=cases(200), database=None, phases=PHASES)
    @given(command_lines())
    def attack(words):
        ended = work.run(*words)
        codes.add(ended.code)
        if ended.code != FINISHED:
            assert ended.said + ended.errors

    attack()
    assert {0, 1, 2} <= codes
    assert {name: (work.folder / name).read_bytes() for name in kept} == kept
