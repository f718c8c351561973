"""One parameter string simulated, and what `agglom simulate` prints and writes of it."""

import json
from collections.abc import Callable, Mapping
from contextlib import suppress
from pathlib import Path
from typing import Any, Final, NamedTuple

import numpy as np
import numpy.typing as npt

from agglom_mpi.analysis.resimulation import (
    AGREEMENT,
    is_same_sample,
    mistaken,
    recorded_parameters,
    recorded_sample,
    row_of_experiment,
)
from agglom_mpi.analysis.run_warnings import EARLY, EARLY_SAMPLES, early_changes, few_left
from agglom_mpi.config.campaign import Campaign
from agglom_mpi.config.loading import load_campaign
from agglom_mpi.config.yaml_source import warn
from agglom_mpi.errors import FAILURE, FINISHED, require_library
from agglom_mpi.file_kinds import is_hdf5
from agglom_mpi.physics.scales import half_width
from agglom_mpi.simulation.boundary import Boundary
from agglom_mpi.simulation.frames import Frames
from agglom_mpi.simulation.sample import Outcome
from agglom_mpi.storage.recorded_campaign import recorded_campaign
from agglom_mpi.verbs.estimate import estimate_of
from agglom_mpi.verbs.simulate import changes_until, simulate

OBJECTIVE_LEFT_OUT: Final = "objective left out: a function is never run from a campaign file"
PARTICLES: Final = "particles.vtkhdf"
FILES: Final = ("cloud.png", "cloud.svg", "evolution.png", "evolution.svg", PARTICLES)
"""Files of the frames of a sample."""
MAX_PANELS: Final = 9
"""Frames that the figure of the cloud shows at most."""


class SimulationRequest(NamedTuple):
    """Options of `agglom simulate`, as `cli/simulate.py` declares them.

    Attributes
    ----------
    source
        A campaign in YAML, or a campaign file with recorded strings.
    settings
        Variables of a YAML campaign, as numbers in SI units or texts with a unit.
    samples
        Number of samples, unless `sample` is given.
    engine
        None: that of the scene.
    string, sample
        Of a campaign file: which string, and which of its samples.
    allow_code
        Whether an objective that is a Python function may be run.
    frames, out
        Number of frames of one sample, and the directory that they are written into; both or
        neither.
    """

    source: Path
    settings: dict[str, float | str]
    samples: int
    engine: str | None
    string: int | None
    sample: int | None
    allow_code: bool = False
    frames: int | None = None
    out: Path | None = None
    strict: bool = False
    """Whether what is unlikely in a YAML campaign is an error."""
    experiment: str | None = None
    """Experiment of a campaign that has several."""


def simulate_string(
    request: SimulationRequest, as_json: bool, show: Callable[[str], None] = lambda line: None
) -> tuple[str, int]:
    """Simulate a parameter string, and return the text to print and the exit code.

    `show` is called with warnings about what is unlikely in a YAML campaign, and about what the
    samples are like.

    Samples that fail are left out and counted. The exit code is 1 if all of them fail, or one
    differs from the recorded one.

    Raises
    ------
    CampaignError
        If the campaign, an option or a variable is wrong.
    ExportError, MissingLibraryError, FileExistsError
        As from `require_output`.
    """
    if request.out is not None:
        require_output(request.out)
        request = request._replace(sample=request.sample or 0)
    campaign, parameters, first, recorded, version = selected_string(request, show)
    if request.experiment is not None:
        own = campaign.of_experiment(request.experiment)
        campaign, parameters = own.campaign, own.own(parameters)
        recorded = None if recorded is None else row_of_experiment(recorded, own.name)
    samples = range(request.samples) if request.sample is None else [request.sample]
    engine, frames = campaign.engine(request.engine), request.frames
    completed: dict[int, Outcome] = {}
    failures: list[str] = []
    with suppress(RuntimeError):
        simulate(campaign, parameters, first + samples[0], engine, frames)  # compiles, not timed
    for number in (first + sample for sample in samples):
        try:
            completed[number] = simulate(campaign, parameters, number, engine, frames)
        except RuntimeError as error:
            failures.append(str(error))
    outcomes = list(completed.values())
    if not outcomes:
        return (json.dumps({"failed": failures[0]}) if as_json else failures[0]), FAILURE
    estimate = estimate_of(campaign, parameters, outcomes, len(failures))
    for line in [
        *few_left(estimate.particles_left.value, campaign.scene.particles),
        *_early_changes(campaign, parameters, completed, engine),
    ]:
        show(f"warning: {line}")
    code, extra = FINISHED, dict[str, Any]()
    function = campaign.user_function
    if failures:
        extra["reasons"] = failures[:1]
    if function is not None and not function.module.source:
        extra["note"] = OBJECTIVE_LEFT_OUT
    if recorded is not None and request.engine is None:
        is_called = function is not None and bool(function.module.source)
        same = is_same_sample(recorded, outcomes[0], version, is_called)
        extra["replay"], code = AGREEMENT[same], FINISHED if same else FAILURE
    if request.out is not None and outcomes[0].frames is not None:
        string = "" if request.string is None else f"string {request.string}, "
        title = f"{campaign.title}: {string}sample {request.sample}"
        scene, values = campaign.at(parameters)
        written = request.out, outcomes[0].frames, half_width(scene, values), title
        extra["files"] = write_frames(*written, scene.escape)
    if as_json:
        return json.dumps(estimate.as_dict() | extra, indent=2), code
    lines = [str(estimate), *extra.get("reasons", [])]
    lines += [extra[name] for name in ("note", "replay") if name in extra]
    return "\n".join([*lines, *extra.get("files", [])]), code


def _early_changes(
    campaign: Campaign,
    parameters: npt.NDArray[np.float64],
    completed: Mapping[int, Outcome],
    engine: Any,
) -> list[str]:
    """Return a line if all changes of the first samples are early; looks until one is not."""
    first = list(completed.items())[:EARLY_SAMPLES]
    changes = 0
    for number, outcome in first:
        total = outcome.merges + outcome.breakups
        if changes_until(campaign, parameters, number, EARLY, engine) < total:
            return []
        changes += total
    return early_changes(changes, len(first)) if changes else []


Selected = tuple[Campaign, npt.NDArray[np.float64], int, np.void | None, int]
"""A string to simulate: its campaign, its parameters, (k,), in SI units, the number of its first
sample in the random streams, and the row of the recorded sample that is simulated again with the
format version of its file; None and 0 without one."""


def selected_string(request: SimulationRequest, show: Callable[[str], None]) -> Selected:
    """Return the string that a request names; raises a CampaignError, see `simulate_string`."""
    return _recorded_string(request) if is_hdf5(request.source) else _set_string(request, show)


def _set_string(request: SimulationRequest, show: Callable[[str], None]) -> Selected:
    if request.string is not None:
        message = "needs a campaign file FILE.h5, not a YAML file"
        raise mistaken(request.source, "--string", message)
    campaign = load_campaign(request.source, request.allow_code)
    parameters = campaign.parameters(request.settings)
    campaign.check_scales(parameters)
    warn(campaign.warnings(request.settings), request.strict, show)
    return campaign, parameters, 0, None, 0


def _recorded_string(request: SimulationRequest) -> Selected:
    from agglom_mpi.storage.reader import read_inversion

    string, sample = request.string, request.sample
    file = read_inversion(request.source, request.allow_code)
    campaign = recorded_campaign(file)
    if request.settings:
        message = "is for YAML files; a recorded string is as it is"
        raise mistaken(request.source, "--set", message)
    parameters, row = recorded_parameters(file, string), None
    if sample is not None and string is not None:
        row = recorded_sample(file, string, sample)
    return campaign, parameters, campaign.first_sample(string or 0), row, file.sizes.version


def require_output(directory: Path) -> None:
    """Check, before anything is simulated, that figures can be drawn and written.

    Raises
    ------
    ExportError, MissingLibraryError
        If the directory is something else, or matplotlib is not installed.
    FileExistsError
        If one of the files is there already.
    """
    from agglom_mpi.report.export import require_directory
    from agglom_mpi.storage.files import require_absent

    require_library("matplotlib", "report", "pictures")
    require_directory(directory)
    for name in FILES:
        require_absent(directory / name)


def write_frames(
    directory: Path,
    frames: Frames,
    half_width: float,
    title: str,
    box: Boundary | None = None,
) -> list[str]:
    """Write the figures of a run and its file for ParaView, and return their paths.

    Parameters
    ----------
    directory
        It is made.
    frames
        The first of them at time 0.
    half_width
        D of the box from −D to D, m.
    title
        What is shown, for the file for ParaView.
    box
        The boundary, whose mean flow is no motion of the grains.

    Raises
    ------
    FileExistsError
        If there is a file for ParaView already.
    OSError
        If they cannot be written.
    """
    # Imported here: printing means needs neither HDF5 nor what draws.
    from agglom_mpi.report.figures.cloud import cloud_size, draw_frames
    from agglom_mpi.report.figures.evolution import draw_evolution, evolution, evolution_size
    from agglom_mpi.report.paraview import write_vtkhdf
    from agglom_mpi.report.style import Drawing, write_drawing

    directory.mkdir(parents=True, exist_ok=True)
    run, shown = evolution(frames, box), panel_frames(len(frames.times))
    drawings = (
        Drawing(
            "cloud",
            f"The particles at {len(shown)} successive times.",
            lambda figure: draw_frames(figure, frames, shown, half_width),
            cloud_size(len(shown)),
        ),
        Drawing(
            "evolution",
            "The particles over time.",
            lambda figure: draw_evolution(figure, run),
            evolution_size(run),
        ),
    )
    for drawing in drawings:
        write_drawing(directory, drawing)
    write_vtkhdf(directory / PARTICLES, frames, title)
    return [str(directory / name) for name in FILES]


def panel_frames(count: int) -> list[int]:
    """Return the indices of the frames to show of `count`: all, or some from first to last."""
    even = np.linspace(0, count - 1, min(count, MAX_PANELS))
    return np.unique(np.rint(even).astype(np.int64)).tolist()
