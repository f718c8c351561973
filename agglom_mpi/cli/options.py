"""Options that several commands have, and how their texts are read."""

from collections.abc import Callable
from pathlib import Path
from typing import Any, Final

import click

PATH: Final = click.Path(path_type=Path)


def examples(*commands: str) -> str:
    """Return what the help of a command ends with: one a line, to be copied."""
    heading = "Examples:" if len(commands) > 1 else "Example:"
    return "\n  ".join([f"\b\n{heading}", *commands])  # \b: click does not wrap what follows


def read_duration(
    context: click.Context, parameter: click.Parameter, text: str | None
) -> float | None:
    """Read seconds: `90`, `90s`, `30m`, `2h`, `1:30:00` or Slurm's `1-12:00:00`."""
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
    if not 0.0 < seconds < float("inf"):
        raise click.BadParameter(
            f"{text!r} is no duration; allowed: 90, 90s, 30m, 2h, 1:30:00, 1-12:00:00"
        )
    return seconds


def read_assignments(
    context: click.Context, parameter: click.Parameter, settings: tuple[str, ...]
) -> dict[str, float | str]:
    """Read `NAME=VALUE`, where a value is a number or a text with a unit."""
    values: dict[str, float | str] = {}
    for setting in settings:
        name, equals, value = setting.partition("=")
        if not equals:
            raise click.BadParameter(f"{setting!r} is not NAME=VALUE", param_hint="--set")
        try:
            values[name.strip()] = float(value)
        except ValueError:
            values[name.strip()] = value.strip()
    return values


ALLOW_CODE: Final = click.option(
    "--allow-code",
    is_flag=True,
    help="Run the Python function that the campaign's objective names.",
)
DATABASE: Final = click.option(
    "--database",
    type=click.Choice(["gathered", "parallel"]),
    help="Who writes samples: rank 0, or every rank its own. "
    "[default: every rank, where h5py was built with MPI]",
)
GENERATIONS: Final = click.option(
    "--generations", type=click.IntRange(1), help="Instead of the campaign's own number."
)
JSON: Final = click.option("--json", "as_json", is_flag=True, help="For machines.")
MAX_WALLTIME: Final = click.option(
    "--max-walltime",
    callback=read_duration,
    metavar="TIME",
    help="Stop cleanly after this long (90, 30m, 2h, 1:30:00); run again to go on.",
)
QUIET: Final = click.option("--quiet", "-q", is_flag=True, help="Show nothing but errors.")
SETTINGS: Final = click.option(
    "--set",
    "settings",
    multiple=True,
    callback=read_assignments,
    metavar="NAME=VALUE",
    help="A variable, with or without unit.",
)


def accept_code_change(what: str) -> Callable[[Any], Any]:
    """Return the option that goes on with a file or a study, whichever is said."""
    return click.option(
        "--accept-code-change",
        is_flag=True,
        help=f"Continue {what} that other simulation sources computed.",
    )
