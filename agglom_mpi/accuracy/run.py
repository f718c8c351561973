"""The command `agglom accuracy`: simulate on all ranks, then write the report."""

import importlib.util
import shlex
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Final

from agglom_mpi.accuracy.display import StudyDisplay
from agglom_mpi.accuracy.document import Header, Part, write_document
from agglom_mpi.accuracy.plan import Options, Plan, make_plan
from agglom_mpi.accuracy.sections import extreme_sections, scene_sections
from agglom_mpi.formatting import format_duration
from agglom_mpi.runtime.file_setup import OutputError, check_writable
from agglom_mpi.runtime.run import RunRequest, run_on_all_ranks
from agglom_mpi.storage.reader import CampaignData, read_campaign
from agglom_mpi.variables import NAMES, VARIABLES

if TYPE_CHECKING:
    from mpi4py.MPI import Intracomm

SAMPLES: Final = "samples.h5"
"""Campaign file of the study, in the directory of the report."""


def accuracy(options: Options, world: "Intracomm | None") -> int:
    """Measure and report on all ranks; the exit code."""
    display = StudyDisplay(options.quiet)
    plans: list[Plan] = []

    def read() -> RunRequest:
        check_libraries()
        plans.append(make_plan(options))
        directory = Path(options.out)
        directory.mkdir(parents=True, exist_ok=True)
        check_writable(directory / SAMPLES)
        path = directory / SAMPLES
        return RunRequest(plans[0].study, path, options.accept_code_change, options.database)

    def finish(request: RunRequest) -> None:
        display.message("writing the report")
        path = report(plans[0], options, read_campaign(request.path))
        display.message(f"{path} with its figures and tables")

    return run_on_all_ranks(read, display, finish, world, max_walltime=options.max_walltime)


def check_libraries() -> None:
    """Raise an OutputError if what draws figures and writes tables is not installed."""
    missing = [name for name in ("matplotlib", "pandas") if importlib.util.find_spec(name) is None]
    if missing:
        raise OutputError(
            f"the report needs {' and '.join(missing)}: pip install 'agglom_mpi[report]'"
        )


def report(plan: Plan, options: Options, file: CampaignData) -> Path:
    """Write the report of a finished study; its path."""
    samples = plan.study.collect(file)
    parts = []
    if plan.campaign is not None:
        parts.append(Part("Error against run time", tuple(scene_sections(plan, samples))))
    if plan.scenes:
        sections = tuple(extreme_sections(plan, samples))
        parts.append(Part("Stiff and extreme cases", sections))
    header = Header(
        f"Accuracy: {plan.study.campaign.title or plan.study.campaign.name}"
        if plan.campaign
        else "Accuracy: stiff and extreme scenes",
        command(options),
        tuple(facts(plan, file)),
    )
    return write_document(Path(options.out), header, parts)


def command(options: Options) -> str:
    """Return the command line that asks for these options."""
    words = ["agglom", "accuracy", *options.sources, "--out", options.out]
    for name, value in options.settings.items():
        words += ["--set", f"{name}={value}"]
    if options.samples is not None:
        words += ["--samples", str(options.samples)]
    if options.history is not None:
        words += ["--history", options.history]
    if options.allow_code:
        words.append("--allow-code")
    return shlex.join([*words, "--quick"] if options.quick else words)


def facts(plan: Plan, file: CampaignData) -> Iterator[str]:
    """Say what was measured, and how long it took."""
    if plan.campaign is not None:
        scene = plan.campaign.scene
        yield f"{scene.particles} particles, volume fraction {_fraction(plan):.3g}"
        units = {variable.name: variable.unit for variable in VARIABLES}
        values = zip(NAMES, plan.parameters.tolist(), strict=True)
        yield ", ".join(
            f"{name} {value:.6g}{'' if units[name] == '1' else ' ' + units[name]}"
            for name, value in values
            if name in plan.campaign.variables.used
        )
    legs, rows = file.legs(), file.all_sample_rows()
    yield (
        f"{'quick' if plan.quick else 'full'} study: {len(plan.study.trials)} set-ups, "
        f"{len(rows)} samples, {format_duration(float(rows['seconds'].sum()))} of processor time "
        f"on "
        f"{int(legs['ranks'].max())} ranks"
    )


def _fraction(plan: Plan) -> float:
    from agglom_mpi.config.bounds import volume_fraction

    return volume_fraction(float(plan.parameters[NAMES.index("size_ratio")]))
