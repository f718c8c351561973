"""The commands `agglom-invert` and `agglom`; each imports only what it needs."""

from importlib import import_module
from typing import Final

import click

from agglom_mpi.cli.launch import launch
from agglom_mpi.cli.options import examples
from agglom_mpi.version import __version__

COMMANDS: Final = {
    "accuracy": "Error against run time, with figures and tables",
    "check": "Is a campaign valid, is a campaign file sound?",
    "doctor": "What this machine has, and what to mend",
    "export": "A campaign file as a compact copy, as tables, for ParaView",
    "plan": "How long a campaign would take on so many ranks",
    "report": "The best strings, a page with figures, or how a run goes",
    "simulate": "One string forward, or a recorded sample again",
}
"""What `agglom --help` says of each command: the function `NAME` of `agglom_mpi.cli.NAME`."""


class _Commands(click.Group):
    """Knows the names and first lines of its commands, and imports the one that is run."""

    def resolve_command(
        self, ctx: click.Context, args: list[str]
    ) -> tuple[str | None, click.Command | None, list[str]]:
        """Find a command by the first argument."""
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
    context_settings={"max_content_width": 100},
)
@click.version_option(__version__)
def main() -> None:
    """Look at campaigns and campaign files, and simulate single strings."""


def agglom() -> None:
    """Run `agglom`."""
    launch(main)


def invert() -> None:
    """Run `agglom-invert`."""
    from agglom_mpi.cli.inversion import invert_command

    launch(invert_command)
