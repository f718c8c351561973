import click
import pytest
from click.testing import CliRunner

from agglom_mpi.cli import main
from agglom_mpi.cli.inversion import invert_command
from agglom_mpi.cli.options import read_duration


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


def test_no_walltime_is_none():
    assert read_duration(None, None, None) is None


@pytest.mark.parametrize(
    "text",
    ["", "soon", "0", "-5", "1d", "1:2:3:4", "5:", "-", "1-", "1-1-1", "nan", "inf", "30 min", "m"],
)
def test_nonsense_is_no_walltime(text):
    with pytest.raises(click.BadParameter, match=r"is no duration; allowed: 90, 90s, 30m"):
        read_duration(None, None, text)


COMMANDS = [(invert_command, []), *((main, [name]) for name in sorted(main.commands))]


@pytest.mark.parametrize(("command", "words"), COMMANDS, ids=lambda item: str(item))
def test_the_help_of_every_command_has_an_example_that_it_understands(command, words):
    result = CliRunner().invoke(command, [*words, "--help"])
    assert result.exit_code == 0
    _, found, example = result.stdout.partition("Example")
    assert found
    assert " ".join(["agglom", *words] if words else ["agglom-invert"]) in example


@pytest.mark.parametrize("name", sorted(main.commands))
def test_the_list_of_commands_says_what_the_help_of_each_begins_with(name):
    _, command, _ = main.resolve_command(click.Context(main), [name])
    assert command.name == name
    assert main.commands[name].help == command.help.partition("\n")[0]


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
