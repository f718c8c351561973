"""Shared by all commands: launching on ranks, exit codes, options and how their texts are read."""

import functools
import io
import logging
import resource
import sys
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, redirect_stdout
from pathlib import Path
from typing import Any, Final

import click

from agglom_mpi.declaration.own_modules import own_error
from agglom_mpi.display.streams import flush_streams, prepare_streams
from agglom_mpi.errors import (
    BAD_INPUT,
    FAILURE,
    FINISHED,
    INTERRUPTED,
    STOPPED,
    UserError,
    error_text,
    exhausted,
)
from agglom_mpi.formatting import printable
from agglom_mpi.launcher import is_first_rank
from agglom_mpi.runtime.stop_request import ignore_signals

LEAST_ADDRESS_SPACE: Final = 1 << 29
"""Minimum address space of a simulation, bytes: with less, libraries abort or hang."""

HELP: Final[dict[str, Any]] = {
    "max_content_width": 100,
    "help_option_names": ["-h", "--help"],
}
"""Settings of the help of all commands."""


def say(text: str, error: bool = False) -> None:
    """Print a text without control sequences, on standard error if asked for."""
    click.echo(printable(text), err=error)


class _SaidOnStandardError(logging.Handler):
    """Prints what the package logs on standard error."""

    def emit(self, record: logging.LogRecord) -> None:
        say(record.getMessage(), error=True)


@contextmanager
def printing_log() -> Iterator[None]:
    """Print the log of the package, such as kernels being compiled, on standard error meanwhile."""
    log, handler = logging.getLogger("agglom_mpi"), _SaidOnStandardError()
    level = log.level
    log.addHandler(handler)
    log.setLevel(logging.INFO)
    try:
        yield
    finally:
        log.setLevel(level)
        log.removeHandler(handler)


def launch(command: click.Command, simulates: bool) -> None:
    """Run a command and end the process; under MPI only the first rank prints help and errors.

    Parameters
    ----------
    command
    simulates
        Whether it is a run that writes its samples: it goes on if nobody reads its output any more,
        and an interrupted one can be continued. Other commands end with `BROKEN_PIPE`.
    """
    prepare_streams(endures=simulates)
    try:
        code = _too_little_memory() if simulates else FINISHED
        code = code or _exit_code(command, simulates)
        flush_streams()
    except OSError as error:
        say(f"{command.name}: {error_text(error)}", error=True)
        code = FAILURE
    if simulates:
        ignore_signals()  # one more of those that stopped the run would change its exit code
    sys.exit(code)


def _too_little_memory() -> int:
    """Return the exit code, and print why, if less memory is allowed than a simulation needs."""
    allowed = resource.getrlimit(resource.RLIMIT_AS)[0]
    if allowed == resource.RLIM_INFINITY or allowed >= LEAST_ADDRESS_SPACE:
        return FINISHED
    if is_first_rank():
        say(
            f"ulimit -v allows {allowed >> 20} MiB of memory; a simulation needs at least "
            f"{LEAST_ADDRESS_SPACE >> 20} MiB",
            error=True,
        )
    return BAD_INPUT


def _exit_code(command: click.Command, simulates: bool) -> int:
    """Run a command, print its errors, and return what the process ends with."""
    try:
        with printing_log() if is_first_rank() else redirect_stdout(None):
            return int(command(standalone_mode=False) or FINISHED)
    except SystemExit as end:
        return int(end.code or FINISHED)
    except click.ClickException as error:
        if is_first_rank():
            shown = io.StringIO()
            error.show(shown)
            say(shown.getvalue().rstrip("\n"), error=True)
        return error.exit_code
    except (click.Abort, KeyboardInterrupt) as end:
        if isinstance(end.__cause__, EOFError):  # click takes any for the end of what is typed
            raise end.__cause__ from None
        if not simulates:
            return INTERRUPTED
        say("interrupted; run the same command again to continue", error=True)
        return STOPPED
    except (ImportError, MemoryError, RuntimeError) as error:
        if not (text := exhausted(error)):
            raise
        say(f"{command.name}: {text}; what was written is whole", error=True)
        return FAILURE


def run_connected(run: Callable[[Any], int]) -> int:
    """Return the exit code of `run`, called with the MPI world, or None for a plain run.

    If the ranks that the launcher started do not find each other, the first one prints why.
    """
    from agglom_mpi.runtime.launch import LaunchError, connect

    try:
        world = connect()
    except LaunchError as error:
        if is_first_rank() or error.every_rank:
            say(str(error), error=True)
        return error.exit_code
    return run(world)


def exit_with(command: Callable[..., int]) -> Callable[..., None]:
    """Return a function that ends the process with the exit code that `command` returns.

    A UserError or an OSError becomes one message on standard error and its exit code, and so does
    a version of Numba that kernels do not work with, and what code of one's own raises.
    """

    @functools.wraps(command)
    def run(**options: Any) -> None:
        try:
            code = command(**options)
        except (UserError, OSError) as error:
            say(error_text(error), error=True)
            code = error.exit_code if isinstance(error, UserError) else BAD_INPUT
        except Exception as error:
            if isinstance(error, ImportError) and error.name == "numba":
                say(str(error), error=True)
                sys.exit(FAILURE)
            if not (text := own_error(error)):
                raise
            say(printable(text), error=True)
            code = FAILURE
        sys.exit(code)

    return run


PATH: Final = click.Path(path_type=Path)


class DependentOption(click.Option):
    """Option that is refused unless one of the options is given that it `needs`, such as `--out`.

    Its help begins with these.
    """

    def __init__(self, *names: Any, needs: str, **settings: Any) -> None:
        super().__init__(*names, **settings | {"help": f"With {needs}: {settings['help']}"})
        self._needs = needs

    def handle_parse_result(
        self, ctx: click.Context, opts: Mapping[str, Any], args: list[str]
    ) -> tuple[Any, list[str]]:
        """Return value and remaining arguments; raise a UsageError for an option out of place."""
        needed = {each.name for each in ctx.command.params if {*each.opts} & {*self._needs.split()}}
        if opts.get(self.name or "") is not None and needed.isdisjoint(opts):
            raise click.UsageError(f"{self.opts[0]} is for {self._needs}")
        return super().handle_parse_result(ctx, opts, args)


def require_own_names(paths: Mapping[str, Path | None], page: Path | None = None) -> None:
    """Raise a UsageError if two of the files to write, by option, have one name.

    Nor may one have that of a file of the web page in the folder `page`.
    """
    named: dict[Path, str] = {}
    for option, path in paths.items():
        if path is None:
            continue
        other = named.setdefault(path.resolve(), option)
        if other != option:
            raise click.UsageError(f"{other} and {option} name the same file; give two names")
        of_page = page is not None and path.resolve().parent == page.resolve()
        if of_page and path.suffix in (".html", ".png", ".svg"):
            raise click.UsageError(f"{option} names a file of the web page; give one like x.csv")


def examples(*commands: str) -> str:
    """Return the end of a command's help: examples to copy, one a line."""
    heading = "Examples:" if len(commands) > 1 else "Example:"
    return "\n  ".join([f"\b\n{heading}", *commands])  # \b: click does not wrap what follows


LONGEST_DURATION: Final = 1e9
"""Maximum duration, s: 30 years, which waits and timers can handle."""


def read_duration(
    context: click.Context, parameter: click.Parameter, text: str | None
) -> float | None:
    """Return a duration in s: `90`, `90s`, `30m`, `2h`, `1:30:00` or Slurm's `1-12:00:00`."""
    if text is None:
        return None
    try:
        days, dash, clock = text.rpartition("-")
        if dash or ":" in clock:
            parts = [float(part) for part in clock.split(":")]
            if dash:  # Slurm's D-H, D-H:M and D-H:M:S
                parts += [0.0] * (3 - len(parts))
            if len(parts) > 3 or (dash and not days):
                raise ValueError
            seconds = sum(part * 60.0**power for power, part in enumerate(reversed(parts)))
        else:
            scale = {"s": 1.0, "m": 60.0, "h": 3600.0}.get(clock[-1:], 0.0)
            seconds = float(clock[:-1]) * scale if scale else float(clock)
        seconds += 86400.0 * float(days or 0)
    except ValueError:
        seconds = -1.0
    if not 0.0 < seconds <= LONGEST_DURATION:
        raise click.BadParameter(
            f"{text!r} is no duration; allowed: 90, 90s, 30m, 2h, 1:30:00, 1-12:00:00"
        )
    return seconds


def read_assignments(
    context: click.Context, parameter: click.Parameter, settings: tuple[str, ...]
) -> dict[str, float | str]:
    """Return `NAME=VALUE` settings by name; a value is a number or a text with a unit."""
    values: dict[str, float | str] = {}
    for setting in settings:
        name, equals, value = setting.partition("=")
        if not equals:
            raise click.BadParameter(f"{setting!r} is not NAME=VALUE", param=parameter)
        try:
            values[name.strip()] = float(value)
        except ValueError:
            values[name.strip()] = value.strip()
    return values


ALLOW_CODE: Final = click.option(
    "--allow-code",
    is_flag=True,
    help="Run the Python code that the campaign names: objective functions, your own components.",
)
UNUSED: Final = click.option(
    "--unused",
    is_flag=True,
    help="Count samples that ran ahead unused, too. Results then depend on the number of ranks and "
    "on timing.",
)
DATABASE: Final = click.option(
    "--database",
    type=click.Choice(["gathered", "parallel"]),
    help="Write samples by rank 0 alone (gathered) or by every rank (parallel). [default: parallel "
    "if h5py was built with MPI]",
)
GENERATIONS: Final = click.option(
    "--generations",
    type=click.IntRange(1, 10**6),
    help="Maximum number of generations; replaces that of the campaign.",
)
STRICT: Final = click.option(
    "--strict",
    is_flag=True,
    help="Treat warnings about unlikely values as errors.",
)
JSON: Final = click.option("--json", "as_json", is_flag=True, help="Print JSON.")
MAX_WALLTIME: Final = click.option(
    "--max-walltime",
    callback=read_duration,
    metavar="TIME",
    help="Stop cleanly after this time (90, 30m, 2h, 1:30:00). The same command continues.",
)
QUIET: Final = click.option("--quiet", "-q", is_flag=True, help="Print errors only.")
SETTINGS: Final = click.option(
    "--set",
    "settings",
    multiple=True,
    callback=read_assignments,
    metavar="NAME=VALUE",
    help="Set a variable, in SI units or with a unit; may be repeated.",
)


def accept_code_change(what: str) -> Callable[[Any], Any]:
    """Return the option that allows continuing `what`, a file or a study, with other sources."""
    return click.option(
        "--accept-code-change",
        is_flag=True,
        help=f"Continue {what} that other simulation sources began; results are then mixed.",
    )
