"""The commands `agglom-invert` and `agglom`; each imports only what it needs."""

import sys
from importlib import import_module
from typing import Final

import click

from agglom_mpi.cli.common import HELP, examples, launch
from agglom_mpi.launcher import is_first_rank
from agglom_mpi.runtime.stop_request import interrupt_on_signals
from agglom_mpi.version import __version__

COMMANDS: Final = {
    "accuracy": "Measure error against run time, with figures and tables",
    "certify": "Prove by fresh runs how much of a feasible set is right",
    "check": "Validate a campaign, or verify a campaign file",
    "compare": "Show which of several laws explains the same data",
    "compile": "Compile the kernels of campaigns ahead of their runs",
    "doctor": "Check this machine: MPI, libraries, storage, batch system",
    "explain": "Explain the keys and laws of a campaign file",
    "export": "Write a compact copy, CSV, netCDF or files for ParaView",
    "kernels": "Count collisions by mass, for population balances",
    "pareto": "Show the trade-off of two numbers over several campaign files",
    "plan": "Estimate run time for different numbers of ranks",
    "report": "Print the best strings, write figures, or follow a run",
    "simulate": "Simulate one string, or replay a recorded sample",
}
"""Name and one-line help of each command; `agglom_mpi.cli.NAME` has the function `NAME`."""


class _Commands(click.Group):
    """Group that lists its commands without importing them, and imports the one that is run."""

    def resolve_command(
        self, ctx: click.Context, args: list[str]
    ) -> tuple[str | None, click.Command | None, list[str]]:
        """Return name, command and remaining arguments; import the module of the command."""
        name, found, rest = super().resolve_command(ctx, args)
        if name is not None:
            found = getattr(import_module(f"{__name__}.{name}"), name)
        return name, found, rest


@click.group(
    "agglom",
    cls=_Commands,
    commands=[click.Command(name, short_help=line) for name, line in COMMANDS.items()],
    epilog=examples(
        "agglom check jobs/quickstart.yaml",
        "agglom-invert jobs/quickstart.yaml",
        "agglom report quickstart.h5",
    ),
    context_settings=HELP,
)
@click.version_option(__version__)
def main() -> None:
    """Check, simulate and plan campaigns; report and export campaign files.

    A campaign CAMPAIGN.yaml asks which parameters make grains grow to a wanted size. The separate
    command agglom-invert runs it, or resumes it, and writes a campaign file FILE.h5. A string is
    one value for each variable of the campaign; a sample is one simulation of a string from a
    random start.
    """


def agglom() -> None:
    """Run `agglom`."""
    launch(main, simulates=sys.argv[1:2] in (["accuracy"], ["certify"], ["compile"]))


def invert() -> None:
    """Run `agglom-invert`."""
    if is_first_rank():
        interrupt_on_signals()
    from agglom_mpi.cli.invert import invert_command

    launch(invert_command, simulates=True)
