"""The commands `agglom-invert` and `agglom`; each imports only what it needs."""

import sys
from collections.abc import Callable
from contextlib import nullcontext, redirect_stdout
from pathlib import Path
from typing import Any

import click

from agglom_mpi import __version__
from agglom_mpi.exit_codes import BAD_INPUT, FAILURE, INTERRUPTED, STOPPED

_PATH = click.Path(path_type=Path)
_MOST_RANKS = 10**6
_DATABASE = click.option(
    "--database",
    type=click.Choice(["gathered", "parallel"]),
    help="Who writes samples: rank 0, or every rank its own. "
    "[default: every rank, where h5py was built with MPI]",
)
_ALLOW_CODE = click.option(
    "--allow-code",
    is_flag=True,
    help="Run the Python function that the campaign's objective names.",
)


def _seconds(context: click.Context, parameter: click.Parameter, text: str | None) -> float | None:
    """Read `90`, `90s`, `30m`, `2h`, `1:30:00` or Slurm's `1-12:00:00`."""
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


def _rank_counts(context: click.Context, parameter: click.Parameter, text: str) -> tuple[int, ...]:
    """Read `1,10,100`."""
    words = [word.strip() for word in text.split(",")]
    counts = [int(word) if word.isdecimal() else 0 for word in words]
    if not all(1 <= count <= _MOST_RANKS for count in counts):
        allowed = f"allowed: numbers from 1 to {_MOST_RANKS} like 1,10,100"
        raise click.BadParameter(f"{text!r} is no list of numbers of ranks; {allowed}")
    return tuple(counts)


def _finish(run: Callable[[], int]) -> int:
    """Turn mistakes of the user's into one message on standard error and an exit code."""
    try:
        return run()
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
    from agglom_mpi.campaign import CampaignError  # which `report` can do without

    if isinstance(error, CampaignError):
        return True
    from agglom_mpi.database.access import NotACampaign  # HDF5, which `check` can do without
    from agglom_mpi.report.export import ExportError

    return isinstance(error, (NotACampaign, ExportError))


@click.command(
    "agglom-invert",
    epilog="Example:  mpirun -n 2 agglom-invert jobs/accretion_2003.yaml",
    context_settings={"max_content_width": 100},
)
@click.argument("campaign")
@click.option(
    "--output", "-o", metavar="FILE.h5", help="Campaign file [default: CAMPAIGN's stem.h5]."
)
@click.option("--generations", type=click.IntRange(1), help="Instead of the campaign's own number.")
@click.option(
    "--max-walltime",
    callback=_seconds,
    metavar="TIME",
    help="Stop cleanly after this long (90, 30m, 2h, 1:30:00); run again to go on.",
)
@click.option("--quiet", "-q", is_flag=True, help="Show nothing but errors.")
@_DATABASE
@click.option(
    "--accept-code-change",
    is_flag=True,
    help="Continue a file that other simulation sources computed.",
)
@_ALLOW_CODE
@click.version_option(__version__)
def invert_command(**options: Any) -> int:
    """Run the inversion that CAMPAIGN (a YAML file) describes, or continue it.

    Started by mpirun it uses all ranks; without, this process. Exit codes: 0 finished, 2 bad input,
    75 stopped early (signal or --max-walltime; run the same command again), 1 anything else.
    """

    def run(world: Any) -> int:
        from agglom_mpi.farm.run import Options, invert

        return invert(Options(**options), world)

    return _connected(run)


def invert() -> None:
    """Run `agglom-invert`."""
    _launch(invert_command)


def agglom() -> None:
    """Run `agglom`."""
    _launch(main)


def _launch(command: click.Command) -> None:
    """Run a command; under MPI only the first rank shows help and usage errors."""
    from agglom_mpi.encoding import write_anything
    from agglom_mpi.farm.launch import is_first_rank

    write_anything()
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


def _connected(run: Callable[[Any], int]) -> int:
    """Run on all ranks that the launcher started, or say why they do not find each other."""
    from agglom_mpi.farm.launch import LaunchError, connect, is_first_rank

    try:
        world = connect()
    except LaunchError as error:
        if is_first_rank():
            click.echo(str(error), err=True)
        return BAD_INPUT
    return run(world)


@click.group("agglom", context_settings={"max_content_width": 100})
@click.version_option(__version__)
def main() -> None:
    """Look at campaigns and campaign files, and simulate single strings."""


@main.command(
    epilog="Examples:  agglom check jobs/quickstart.yaml   agglom check accretion_2003.h5"
)
@click.argument("file")
def check(file: str) -> None:
    """Validate CAMPAIGN.yaml and print what would run, or verify what FILE.h5 holds.

    Of a campaign file, also while it is being written: whether every final row is whole, the
    numbers agree, and the search decides again from the samples what it decided. Exit codes of
    that: 0 sound, 1 damaged, 2 no campaign file or one of a newer version.
    """

    def run() -> int:
        if _is_hdf5(file):
            from agglom_mpi.farm.check import check_file

            text, code = check_file(file)
            click.echo(text)
            return code
        from agglom_mpi.campaign import check_campaign

        loaded = check_campaign(file)
        if loaded.plan is None:
            loaded.check_scales(loaded.parameters())
        else:
            loaded.check_searchable()
        click.echo(loaded.describe())
        return 0

    sys.exit(_finish(run))


def _is_hdf5(path: str) -> bool:
    """Whether a path is to be read as HDF5: by what the file begins with, or by its name."""
    if path.endswith(".h5"):
        return True
    try:
        with open(path, "rb") as file:
            return file.read(8) == b"\x89HDF\r\n\x1a\n"
    except OSError:
        return False


@main.command(
    epilog="Examples:  agglom report accretion_2003.h5   "
    "agglom report accretion_2003.h5 --out report   agglom report seed1.h5 seed2.h5"
)
@click.argument("files", nargs=-1, required=True, metavar="FILE...")
@click.option(
    "--out",
    type=_PATH,
    metavar="DIR",
    help="Write a web page, report.html, and its figures instead, as PNG and SVG.",
)
@click.option(
    "--stored-only",
    is_flag=True,
    help="With --out: particles that are not stored are not simulated again.",
)
@click.option(
    "--sensitivity", is_flag=True, help="Also which variables matter, by a regression; seconds."
)
@click.option("--json", "as_json", is_flag=True, help="For machines.")
@click.option("--follow", is_flag=True, help="First show how its run goes, until it ends.")
def report(
    files: tuple[str, ...],
    out: Path | None,
    stored_only: bool,
    sensitivity: bool,
    as_json: bool,
    follow: bool,
) -> None:
    """Print the best strings of a campaign FILE.h5, also while it is being written.

    They are ranked by their re-estimates on fresh samples, where there are any. Several files are
    compared by their best strings. The web page needs nothing but itself; existing files are
    replaced only if they have the names of its own. Exit codes with --follow are those of the run,
    and 130 after Ctrl-C, which does not touch it.
    """
    options = {"--sensitivity": sensitivity, "--out": out is not None, "--follow": follow}
    for option, given in options.items():
        if len(files) > 1 and given:
            raise click.UsageError(f"{option} is of one file")
    if out is None and stored_only:
        raise click.UsageError("--stored-only is for --out DIR")
    if out is not None and as_json:
        raise click.UsageError("give --out or --json, not both")

    def run() -> int:
        code = _follow(files[0]) if follow else 0
        if code == INTERRUPTED:
            return code
        if out is not None:
            _page(files[0], out, not stored_only, sensitivity)
            return code
        from agglom_mpi.report.display import print_wide

        several = len(files) > 1
        text = _comparison(files, as_json) if several else _summary(files[0], sensitivity, as_json)
        click.echo(text) if as_json else print_wide(text)
        return code

    sys.exit(_finish(run))


def _follow(file: str) -> int:
    """Show how a run goes until it ends; its exit code, or `INTERRUPTED`."""
    from agglom_mpi.database.reader import open_inversion
    from agglom_mpi.report.follow import follow

    return follow(open_inversion(file))


def _page(file: str, out: Path, again: bool, sensitivity: bool) -> None:
    """Write the web page of a file, and say so."""
    from agglom_mpi.database.reader import open_inversion
    from agglom_mpi.report.page import write_report

    for line in write_report(open_inversion(file), out, again, sensitivity):
        click.echo(line)


def _summary(file: str, sensitivity: bool, as_json: bool) -> Any:
    """Return what one file found, to be printed."""
    from agglom_mpi.database.reader import open_inversion
    from agglom_mpi.report.summary import as_text, collect_summary, summarise

    opened, more = open_inversion(file), None
    if sensitivity:
        from agglom_mpi.report import sensitivity as matters

        more = matters.of_campaign(opened)
    if as_json:
        extra = {} if more is None else {"sensitivity": matters.as_dict(*more)}
        return as_text(collect_summary(opened), extra)
    from rich.console import Group

    return Group(summarise(opened), *([] if more is None else [matters.in_words(*more)]))


def _comparison(files: tuple[str, ...], as_json: bool) -> Any:
    """Return what several files found, to be printed."""
    from agglom_mpi.database.reader import open_inversion
    from agglom_mpi.report import comparison

    compared = comparison.compare([open_inversion(file) for file in files])
    return comparison.as_text(compared) if as_json else comparison.in_words(compared)


@main.command(
    epilog="Examples:  agglom export accretion_2003.h5 --compact accretion_2003_compact.h5   "
    "agglom export accretion_2003.h5 --csv tables   "
    "agglom export accretion_2003.h5 --paraview best.vtkhdf"
)
@click.argument("file")
@click.option("--compact", type=_PATH, metavar="OUT.h5", help="A compressed copy of the file.")
@click.option(
    "--csv",
    type=_PATH,
    metavar="DIR",
    help="The tables as strings.csv, samples.csv and generations.csv.",
)
@click.option(
    "--paraview",
    type=_PATH,
    metavar="OUT.vtkhdf",
    help="The particles of a sample over time, for ParaView; of several samples OUT_STRING_SAMPLE "
    "each.",
)
@click.option("--string", type=click.IntRange(0), help="String to show.  [default: the best]")
@click.option(
    "--sample",
    "samples",
    type=click.IntRange(0),
    multiple=True,
    help="Sample of it to show; may be repeated.  [default: all with stored frames, or the first]",
)
@click.option(
    "--frames",
    type=click.IntRange(1),
    help="Simulate the sample again, and take so many frames.  [default: those stored, or 101]",
)
def export(
    file: str,
    compact: Path | None,
    csv: Path | None,
    paraview: Path | None,
    string: int | None,
    samples: tuple[int, ...],
    frames: int | None,
) -> None:
    """Write a campaign FILE.h5 in another form; give --compact, --csv, --paraview or more of them.

    What is final is taken, also while the file is being written; no existing file is overwritten.
    A sample that there are no stored frames of is simulated again, exactly.
    """
    if compact is None and csv is None and paraview is None:
        message = "nothing to write: give --compact OUT.h5, --csv DIR or --paraview OUT.vtkhdf"
        raise click.UsageError(message)
    if paraview is None and (string is not None or samples or frames is not None):
        raise click.UsageError("--string, --sample and --frames are for --paraview OUT.vtkhdf")

    def run() -> int:
        from agglom_mpi.report.export import export

        choice = None
        if paraview is not None:
            from agglom_mpi.report.paraview import Choice

            choice = Choice(paraview, string, samples, frames)
        for line in export(Path(file), compact, csv, choice):
            click.echo(line)
        return 0

    sys.exit(_finish(run))


@main.command(
    epilog="Examples:  agglom simulate jobs/accretion_2003.yaml --set density=6000 --samples 100   "
    "agglom simulate accretion_2003.h5 --string 42 --sample 17   "
    "agglom simulate jobs/accretion_2003.yaml --frames 100 --out run"
)
@click.argument("source")
@click.option(
    "--set",
    "settings",
    multiple=True,
    metavar="NAME=VALUE",
    help="A variable, with or without unit.",
)
@click.option("--samples", type=click.IntRange(1), help="Samples to average.  [default: 10]")
@click.option(
    "--engine",
    help="event, fixed, fixed:STEPS or adaptive, instead of the scene's own; event cools exactly, "
    "also where the scene says euler.",
)
@click.option("--string", type=click.IntRange(0), help="Replay this string of a campaign file.")
@click.option("--sample", type=click.IntRange(0), help="Replay this one sample.")
@click.option(
    "--frames",
    type=click.IntRange(2),
    help="Look at one sample, the first or --sample, at so many times.",
)
@click.option(
    "--out",
    type=_PATH,
    metavar="DIR",
    help="Directory of its pictures, PNG and SVG, and of its file for ParaView.",
)
@_ALLOW_CODE
@click.option("--json", "as_json", is_flag=True, help="For machines.")
def simulate(
    source: str,
    settings: tuple[str, ...],
    samples: int | None,
    engine: str | None,
    string: int | None,
    sample: int | None,
    frames: int | None,
    out: Path | None,
    allow_code: bool,
    as_json: bool,
) -> None:
    """Simulate one parameter string forward, of CAMPAIGN.yaml or as recorded in FILE.h5.

    Variables that are ranges and not --set take the middle of their range. --frames and --out show
    one sample: its particles at successive times (9 of them at most), how it evolves, and all
    frames as a file for ParaView; no existing file is overwritten.
    """
    if (frames is None) != (out is None):
        raise click.UsageError("--frames F and --out DIR belong together")
    if frames is not None and samples is not None:
        raise click.UsageError("--frames shows one sample; choose it with --sample, not --samples")

    def run() -> int:
        from agglom_mpi.report.forward import Request, forward

        values, count = _assignments(settings), samples or 10
        look = (allow_code, frames, out)
        request = Request(Path(source), values, count, engine, string, sample, *look)
        text, code = forward(request, as_json)
        click.echo(text)
        return code

    sys.exit(_finish(run))


@main.command(
    epilog="Examples:  agglom plan jobs/agglomeration_2004.yaml --ranks 1,64,1024   "
    "agglom plan jobs/accretion_2003.yaml --from accretion_2003.h5"
)
@click.argument("campaign")
@click.option(
    "--ranks",
    callback=_rank_counts,
    default="1,10,100,1000",
    show_default=True,
    metavar="N,N,...",
    help="Numbers of ranks.",
)
@click.option(
    "--from",
    "source",
    metavar="FILE.h5",
    help="Campaign file, finished or not, whose samples to take instead of simulating some.",
)
@click.option(
    "--seconds",
    type=click.FloatRange(0.0, min_open=True),
    default=20.0,
    show_default=True,
    help="Time to simulate samples for.",
)
@click.option("--generations", type=click.IntRange(1), help="Instead of the campaign's own number.")
@_ALLOW_CODE
@click.option("--json", "as_json", is_flag=True, help="For machines.")
def plan(as_json: bool, **options: Any) -> None:
    """Forecast how long CAMPAIGN.yaml would take on so many ranks like this machine's.

    Samples of random strings are simulated here, in one process, to see what they give and how
    long they take; then the campaign's own decisions and scheduling run on ranks that are imagined.
    That is a rough guide; the file of a few generations, with --from, is a better one. Exit code 1
    if a forecast would take too many samples.
    """

    def run() -> int:
        from agglom_mpi.farm.plan import Options, plan
        from agglom_mpi.farm.plan_words import as_text, in_words
        from agglom_mpi.report.display import print_wide

        made = plan(Options(**options))
        if as_json:
            click.echo(as_text(made))
        else:
            print_wide(in_words(made))
        return FAILURE if made.refused else 0

    sys.exit(_finish(run))


@main.command(
    epilog="Examples:  agglom accuracy jobs/quickstart.yaml --quick --out accuracy   "
    "mpirun -n 2 agglom accuracy jobs/accretion_2003.yaml --history accretion_2003.h5 --out study"
)
@click.argument("sources", nargs=-1, required=True, metavar="SOURCE...")
@click.option("--out", "-o", required=True, metavar="DIR", help="Directory of the report.")
@click.option("--quick", is_flag=True, help="Few set-ups and samples, under a minute.")
@click.option(
    "--set",
    "settings",
    multiple=True,
    metavar="NAME=VALUE",
    help="A variable, with or without unit.",
)
@click.option(
    "--samples", type=click.IntRange(2, 10**6), help="Samples of each set-up instead of the usual."
)
@click.option(
    "--history", metavar="FILE.h5", help="Campaign file whose best strings to estimate again."
)
@click.option(
    "--max-walltime",
    callback=_seconds,
    metavar="TIME",
    help="Stop cleanly after this long (90, 30m, 2h, 1:30:00); run again to go on.",
)
@click.option("--quiet", "-q", is_flag=True, help="Show nothing but errors.")
@_DATABASE
@click.option(
    "--accept-code-change",
    is_flag=True,
    help="Continue a study that other simulation sources computed.",
)
@_ALLOW_CODE
def accuracy(settings: tuple[str, ...], **options: Any) -> None:
    """Measure error against run time, and write a report with figures and tables.

    SOURCE is a scene or campaign, which is measured knob by knob (time steps, impact solver,
    cooling, ensembles, box), or a directory of extreme scenes, which are run as they are and as
    published. Variables that are ranges and not --set take the middle of their range. Started by
    mpirun it uses all ranks; run again, it goes on.
    """

    def run(world: Any) -> int:
        from agglom_mpi.accuracy.plan import Options
        from agglom_mpi.accuracy.run import accuracy

        return accuracy(Options(settings=_assignments(settings), **options), world)

    sys.exit(_connected(run))


@main.command(epilog="Examples:  agglom doctor   agglom doctor /scratch/me")
@click.argument(
    "folder", type=click.Path(exists=True, file_okay=False, path_type=Path), default="."
)
def doctor(folder: Path) -> None:
    """Tell what this machine has to run campaigns with, and what to mend.

    MPI and its launcher, HDF5, compiled kernels, processors, the file system of FOLDER, the batch
    system. Exit code 1 if campaigns do not run like this on several ranks.
    """

    def run() -> int:
        from agglom_mpi.doctor.run import examine, in_words
        from agglom_mpi.report.display import print_wide

        findings = list(examine(folder.resolve()))
        print_wide(in_words(findings))
        return FAILURE if any(finding.broken for finding in findings) else 0

    sys.exit(_finish(run))


def _assignments(settings: tuple[str, ...]) -> dict[str, float | str]:
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
