"""Options of the commands that compute a feasible set, or the posterior of a measured mean."""

from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, Any, TypeVar

import click

from agglom_mpi.cli.common import DependentOption, read_assignments

if TYPE_CHECKING:
    from agglom_mpi.report.set_files import SetRequest

Command = TypeVar("Command", bound=Callable[..., Any])


def set_options(owner: str, further: str = "") -> Callable[[Command], Command]:
    """Return a decorator adding `--tolerance`, `--robust`, `--measured`, `--error` for an option.

    A tolerance may also be that of `further` options.
    """
    tolerance = click.option(
        "--tolerance",
        cls=DependentOption,
        needs=f"{owner}{further}",
        metavar="SHARE",
        help="tolerance relative to the target or the maximum (5% or 0.05); for a Python function, "
        "its largest allowed value.  [default: 5%]",
    )
    robust = click.option(
        "--robust",
        cls=DependentOption,
        needs=owner,
        multiple=True,
        callback=read_assignments,
        metavar="NAME=SHARE",
        help="average probabilities over even deviations of a variable by up to this share of "
        "itself, not beyond the box (relative_speed=5%); may be repeated.",
    )
    measured = click.option(
        "--measured",
        cls=DependentOption,
        needs=owner,
        metavar="NUMBER",
        help="measured mean b/b0, for the posterior of the variables.",
    )
    error = click.option(
        "--error",
        cls=DependentOption,
        needs="--measured",
        metavar="NUMBER",
        help="standard error of the measured mean (0.04), or a percentage (2%).",
    )
    return lambda command: tolerance(robust(measured(error(command))))


def read_set_request(options: Mapping[str, Any], *files: str) -> "SetRequest":
    """Return what the values of `set_options`, and of options of `files` to write, ask for.

    Raises
    ------
    click.UsageError
        If a measured mean has no error.
    """
    if options["measured"] is not None and options["error"] is None:
        raise click.UsageError("--measured and --error go together")
    from agglom_mpi.config.plan import DEFAULT_TOLERANCE
    from agglom_mpi.report.set_files import SetRequest

    given = {name: options[name] for name in ("measured", "error", "robust", *files)}
    return SetRequest(options["tolerance"] or DEFAULT_TOLERANCE, **given)
