import shlex
from pathlib import Path

import click
import pytest
from click.testing import CliRunner

from agglom_mpi.cli import main
from agglom_mpi.cli.common import exit_with, read_duration
from agglom_mpi.cli.invert import invert_command

ROOT = Path(__file__).parents[2]


@pytest.mark.parametrize(
    ("text", "seconds"),
    [
        ("90", 90),
        ("90s", 90),
        ("0.5", 0.5),
        ("30m", 1800),
        ("1.5h", 5400),
        ("2h", 7200),
        ("5:00", 300),
        ("1:30:00", 5400),
        ("1-12:00:00", 129600),
        ("1-12:30", 131400),
        ("2-0", 172800),
        ("0-0:01:30", 90),
    ],
)
def test_a_walltime_is_read(text, seconds):
    assert read_duration(None, None, text) == seconds


def test_a_version_of_numba_that_does_not_do_is_one_message(capsys):
    @exit_with
    def command():
        raise ImportError("numba 9 is not a version that kernels were tried with", name="numba")

    with pytest.raises(SystemExit) as ended:
        command()
    assert ended.value.code == 1
    assert capsys.readouterr().err == "numba 9 is not a version that kernels were tried with\n"


def test_no_walltime_is_none():
    assert read_duration(None, None, None) is None


@pytest.mark.parametrize(
    "text",
    [
        "",
        "soon",
        "0",
        "-5",
        "1d",
        "1:2:3:4",
        "5:",
        "-",
        "1-",
        "1-1-1",
        "nan",
        "inf",
        "30 min",
        "m",
        "1e300h",
    ],
)
def test_nonsense_is_no_walltime(text):
    with pytest.raises(click.BadParameter, match=r"allowed: 90, 90s, 30m"):
        read_duration(None, None, text)


COMMANDS = [
    (invert_command, []),
    (main, []),
    *((main, [name]) for name in sorted(main.commands)),
]


def understand(line):
    """Read an example as its command does, which runs nothing."""
    program, *words = shlex.split(line.removeprefix("mpirun -n 2 "))
    for word in words:
        assert not word.startswith("jobs/") or (ROOT / word).exists(), word
    if program == invert_command.name:
        return invert_command.make_context(program, words)
    assert program == main.name
    name, command, words = main.resolve_command(click.Context(main), words)
    return command.make_context(name, words)


@pytest.mark.parametrize(("command", "words"), COMMANDS, ids=lambda item: str(item))
def test_the_help_of_every_command_ends_with_examples_that_it_understands(command, words):
    result = CliRunner().invoke(command, [*words, "--help"])
    assert result.exit_code == 0
    heading, *lines = result.stdout.rpartition("\n\n")[2].splitlines()
    assert heading == ("  Examples:" if len(lines) > 1 else "  Example:")
    assert lines
    for line in lines:
        understand(line.strip())
        assert " ".join(["agglom", *words]) in line


@pytest.mark.parametrize("name", sorted(main.commands))
def test_the_list_of_commands_says_in_a_line_what_each_that_is_there_does(name):
    _, command, _ = main.resolve_command(click.Context(main), [name])
    assert command.name == name
    listed = CliRunner().invoke(main, ["--help"], terminal_width=80).stdout
    [line] = [line for line in listed.splitlines() if line.startswith(f"  {name} ")]
    assert line.split(maxsplit=1)[1] == main.commands[name].short_help


@pytest.mark.parametrize(("command", "words"), [(main, []), (main, ["plan"]), (invert_command, [])])
def test_the_short_option_gives_the_same_help(command, words):
    short, long = (CliRunner().invoke(command, [*words, each]) for each in ("-h", "--help"))
    assert short.stdout == long.stdout
    assert short.exit_code == 0


def test_the_version_is_the_packages():
    import agglom_mpi

    result = CliRunner().invoke(main, ["--version"])
    assert agglom_mpi.__version__ in result.stdout


@pytest.mark.parametrize(
    "arguments",
    [[], ["a.yaml", "b.yaml"], ["a.yaml", "--generations", "0"], ["a.yaml", "--quietly"]],
)
def test_wrong_usage_is_exit_code_2(arguments):
    result = CliRunner().invoke(invert_command, arguments)
    assert result.exit_code == 2
    assert "Error: " in result.stderr
