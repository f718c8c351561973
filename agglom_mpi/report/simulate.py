"""One parameter string simulated, and what `agglom simulate` prints and writes of it."""

import json
import math
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final, NamedTuple

import numpy as np
import numpy.typing as npt

from agglom_mpi.analysis.resimulation import (
    AGREEMENT,
    is_same,
    mistaken,
    recorded_campaign,
    recorded_parameters,
    recorded_sample,
)
from agglom_mpi.config.campaign import Campaign
from agglom_mpi.config.loading import load_campaign
from agglom_mpi.errors import require_library
from agglom_mpi.formatting import value_with_error
from agglom_mpi.outcome import LEDGER
from agglom_mpi.simulation.frames import Frames
from agglom_mpi.simulation.sample import Outcome
from agglom_mpi.statistics import mean_of
from agglom_mpi.storage.signature import is_hdf5
from agglom_mpi.variables import NAMES, VARIABLES

if TYPE_CHECKING:
    from agglom_mpi.storage.reader import CampaignData

OBJECTIVE_LEFT_OUT: Final = "objective left out: a function is never run from a campaign file"
PARTICLES: Final = "particles.vtkhdf"
FILES: Final = ("cloud.png", "cloud.svg", "evolution.png", "evolution.svg", PARTICLES)
"""Files of the frames of a sample."""
MAX_PANELS: Final = 9
"""Frames that the figure of the cloud shows at most."""


class SimulationRequest(NamedTuple):
    """What `agglom simulate` is asked for.

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


class SelectedString(NamedTuple):
    """The string that is simulated.

    Attributes
    ----------
    campaign
    parameters
        Shape (10,), SI units.
    first_sample
        Number of its first sample in the campaign's random streams.
    recorded
        Row of the recorded sample that is simulated again, if there is one.
    format_version
        Of the file that it is recorded in.
    """

    campaign: Campaign
    parameters: npt.NDArray[np.float64]
    first_sample: int = 0
    recorded: np.void | None = None
    format_version: int = 0


def simulate_string(request: SimulationRequest, as_json: bool) -> tuple[str, int]:
    """Simulate a parameter string, and return the text to print and the exit code.

    The exit code is 1 if a sample fails, or differs from the recorded one.

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
    selected = _recorded_string(request) if is_hdf5(request.source) else _set_string(request)
    campaign, parameters, first, recorded, version = selected
    samples = range(request.samples) if request.sample is None else [request.sample]
    numbers = [first + sample for sample in samples]
    engine, frames = campaign.engine(request.engine), request.frames
    try:
        campaign.simulate(parameters, numbers[0], engine, frames)  # compiles, not to be timed
        outcomes = [campaign.simulate(parameters, number, engine, frames) for number in numbers]
    except RuntimeError as error:
        return (json.dumps({"failed": str(error)}) if as_json else str(error)), 1
    report, code = _report(campaign, parameters, outcomes), 0
    if campaign.user_function is not None and campaign.user_function.source is None:
        report["note"] = OBJECTIVE_LEFT_OUT
    if recorded is not None and request.engine is None:
        same = is_same(recorded, outcomes[0].record, version)
        report["replay"] = AGREEMENT[same]
        code = 0 if same else 1
    if request.out is not None:
        report["files"] = _write_frames(request, campaign, outcomes[0])
    return (json.dumps(report, indent=2) if as_json else _as_text(report)), code


def _set_string(request: SimulationRequest) -> SelectedString:
    """Return the string that the settings of a YAML campaign make."""
    if request.string is not None:
        message = "needs a campaign file FILE.h5, not a YAML file"
        raise mistaken(request.source, "--string", message)
    campaign = load_campaign(request.source, request.allow_code)
    return SelectedString(campaign, campaign.parameters(request.settings))


def _recorded_string(request: SimulationRequest) -> SelectedString:
    """Return the recorded string of a campaign file."""
    from agglom_mpi.storage.reader import read_inversion

    file = read_inversion(request.source)
    campaign = recorded_campaign(file)
    if request.settings:
        message = "is for YAML files; a recorded string is as it is"
        raise mistaken(request.source, "--set", message)
    parameters = recorded_parameters(file, request.string)
    first = campaign.first_sample(request.string or 0)
    row = _recorded_row(request, file)
    return SelectedString(campaign, parameters, first, row, file.format_version)


def _recorded_row(request: SimulationRequest, file: "CampaignData") -> np.void | None:
    if request.sample is None or request.string is None:
        return None
    return recorded_sample(file, request.string, request.sample)


def _mean(values: list[float]) -> dict[str, float | None]:
    value, error, _ = mean_of(values)
    return {"mean": value, "standard_error": _finite(error)}


def _finite(value: float) -> float | None:
    return value if math.isfinite(value) else None


def _report(
    campaign: Campaign, parameters: npt.NDArray[np.float64], outcomes: list[Outcome]
) -> dict[str, Any]:
    """Return means over the outcomes, and the worst of each column of the ledger, for JSON."""
    objective = campaign.objective.build(campaign.scene.particles)
    ratios = [outcome.mean_radius_ratio for outcome in outcomes]
    value, error = objective.of_ensemble([outcome.measured for outcome in outcomes])
    measured = {
        "mean_radius_ratio": _mean(ratios),
        "radius_spread": _mean([math.sqrt(outcome.moments[1]) for outcome in outcomes]),
        "particles_left": _mean([float(outcome.particles) for outcome in outcomes]),
        "temperature_K": _mean([float(outcome.record["mean_temperature"]) for outcome in outcomes]),
        "collisions": _mean([float(outcome.collisions) for outcome in outcomes]),
        "merges": _mean([float(outcome.merges) for outcome in outcomes]),
        "breakups": _mean([float(outcome.breakups) for outcome in outcomes]),
        "steps": _mean([float(outcome.steps) for outcome in outcomes]),
        "seconds": _mean([outcome.seconds for outcome in outcomes]),
    }
    used = campaign.variables.used
    return {
        "parameters": {n: float(v) for n, v in zip(NAMES, parameters, strict=True) if n in used},
        "samples": len(outcomes),
        "objective": {"mean": _finite(value), "standard_error": _finite(error)},
        "measured": measured,
        "ledger": {
            name: max((outcome.ledger[name] for outcome in outcomes), key=abs) for name in LEDGER
        },
    }


def _as_text(report: dict[str, Any]) -> str:
    """Return a report as lines for the terminal."""
    units = {variable.name: variable.unit for variable in VARIABLES}
    lines = ["parameters"]
    for name, value in report["parameters"].items():
        unit = "" if units[name] == "1" else f" {units[name]}"
        lines.append(f"  {name:<22}{value:.6g}{unit}")
    lines.append(f"mean ± standard error over {report['samples']} samples")
    for name, entry in {"objective": report["objective"], **report["measured"]}.items():
        mean, error = (math.nan if v is None else v for v in entry.values())
        lines.append(f"  {name:<22}{value_with_error(mean, error)}")
    lines.append("ledger, worst sample")
    lines.extend(f"  {name:<22}{value:.3g}" for name, value in report["ledger"].items())
    lines.extend(report[name] for name in ("note", "replay") if name in report)
    lines.extend(report.get("files", []))
    return "\n".join(lines)


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


def _write_frames(request: SimulationRequest, campaign: Campaign, outcome: Outcome) -> list[str]:
    """Write the frames of an outcome, and return the paths of their files."""
    assert request.out is not None
    assert outcome.frames is not None
    string = "" if request.string is None else f"string {request.string}, "
    title = f"{campaign.title}: {string}sample {request.sample}"
    return write_frames(request.out, outcome.frames, campaign.scene.half_width, title)


def write_frames(directory: Path, frames: Frames, half_width: float, title: str) -> list[str]:
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

    Raises
    ------
    FileExistsError
        If there is a file for ParaView already.
    OSError
        If they cannot be written.
    """
    # Imported here: printing means needs neither HDF5 nor what draws.
    from agglom_mpi.report.drawing import Drawing, write_drawing
    from agglom_mpi.report.figures.cloud import cloud_size, draw_frames
    from agglom_mpi.report.figures.evolution import draw_evolution, evolution, evolution_size
    from agglom_mpi.report.paraview import write_vtkhdf

    directory.mkdir(parents=True, exist_ok=True)
    run, shown = evolution(frames), panel_frames(len(frames.times))
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
