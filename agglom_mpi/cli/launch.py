"""How a command is launched and how it ends: on which ranks, with which exit code and message."""

import functools
import sys
from collections.abc import Callable
from contextlib import nullcontext, redirect_stdout
from typing import Any

import click

from agglom_mpi.exit_codes import BAD_INPUT, FAILURE, STOPPED


def launch(command: click.Command) -> None:
    """Run a command; under MPI only the first rank shows help and usage errors."""
    from agglom_mpi.formatting import replace_unencodable
    from agglom_mpi.launcher import is_first_rank

    replace_unencodable()
    try:
        with nullcontext() if is_first_rank() else redirect_stdout(None):
            code = command(standalone_mode=False)
    except click.ClickException as error:
        if is_first_rank():
            error.show()
        code = error.exit_code
    except (click.Abort, KeyboardInterrupt):
        click.echo("interrupted; run the same command again to go on", err=True)
        code = STOPPED
    except OSError as error:
        click.echo(f"{command.name}: {error}", err=True)
        code = FAILURE
    sys.exit(code)


def connected(run: Callable[[Any], int]) -> int:
    """Run on all ranks that the launcher started, or say why they do not find each other."""
    from agglom_mpi.launcher import is_first_rank
    from agglom_mpi.runtime.launch import LaunchError, connect

    try:
        world = connect()
    except LaunchError as error:
        if is_first_rank():
            click.echo(str(error), err=True)
        return BAD_INPUT
    return run(world)


def exits(command: Callable[..., int]) -> Callable[..., None]:
    """Let a function end the process with the exit code that it returns.

    A mistake of the user's becomes one message on standard error and its exit code.
    """

    @functools.wraps(command)
    def run(**options: Any) -> None:
        sys.exit(_finish(lambda: command(**options)))

    return run


def _finish(run: Callable[[], int]) -> int:
    try:
        return run()
    except click.ClickException:  # which `launch` shows
        raise
    except OSError as error:
        known = error.filename and error.strerror
        click.echo(f"{error.filename}: {error.strerror}" if known else str(error), err=True)
    except Exception as error:
        if not _is_mistake(error):
            raise
        click.echo(str(error), err=True)
        return int(getattr(error, "exit_code", BAD_INPUT))
    return BAD_INPUT


def _is_mistake(error: Exception) -> bool:
    """Whether an error says in one message what the user did wrong."""
    from agglom_mpi.config.yaml_source import CampaignError  # which `report` can do without

    if isinstance(error, CampaignError):
        return True
    from agglom_mpi.report.requirements import ExportError
    from agglom_mpi.storage.access import NotACampaign  # HDF5, which `check` can do without

    return isinstance(error, (NotACampaign, ExportError))
