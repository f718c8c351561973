"""Options of the commands that compute a feasible set, or the posterior of a measured mean."""

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

import click

from agglom_mpi.cli.common import checked_by
from agglom_mpi.config.arguments import read_amount, read_number

if TYPE_CHECKING:
    from agglom_mpi.report.set_files import SetRequest

Command = TypeVar("Command", bound=Callable[..., Any])


def set_options(owner: str) -> Callable[[Command], Command]:
    """Return a decorator that adds `--tolerance`, `--measured` and `--error`, for an option."""
    options = [
        click.option(
            "--tolerance",
            callback=checked_by(read_amount),
            metavar="SHARE",
            help=f"With {owner}: tolerance relative to the target or the maximum (5% or 0.05); for "
            "a Python function, its largest allowed value.  [default: 5%]",
        ),
        click.option(
            "--measured",
            callback=checked_by(read_number),
            metavar="NUMBER",
            help=f"With {owner}: measured mean b/b0, for the posterior of the variables.",
        ),
        click.option(
            "--error",
            callback=checked_by(read_amount),
            metavar="NUMBER",
            help="With --measured: standard error of the measured mean (0.04), or a percentage "
            "(2%).",
        ),
    ]

    def decorate(command: Command) -> Command:
        for option in reversed(options):
            command = option(command)
        return command

    return decorate


def read_set_request(
    owner: str,
    wanted: bool,
    tolerance: str | None,
    measured: str | None,
    error: str | None,
    **files: Path | None,
) -> "SetRequest | None":
    """Return what is asked of the feasible set; None if it is not `wanted`.

    Parameters
    ----------
    owner
        The option that asks for it, as messages show it.
    wanted
        Whether it is given.
    tolerance, measured, error
        Values of `set_options`.
    files
        Values of `--draws` and `--grid`, for commands that have them.

    Raises
    ------
    click.UsageError
        If an option is given without the one that it is for.
    """
    given = {"tolerance": tolerance, "measured": measured, "error": error, **files}
    for name, value in given.items():
        if value is not None and not wanted:
            raise click.UsageError(f"--{name} is for {owner}")
    if not wanted:
        return None
    if (measured is None) != (error is None):
        raise click.UsageError("--measured and --error go together")
    if files.get("draws") is not None and measured is None:
        raise click.UsageError("--draws is for --measured")
    from agglom_mpi.report.set_files import DEFAULT_TOLERANCE, SetRequest

    return SetRequest(tolerance or DEFAULT_TOLERANCE, measured, error, **files)
