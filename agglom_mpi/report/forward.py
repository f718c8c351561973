"""One parameter string, simulated forward: what `agglom simulate` prints."""

import json
import math
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final, NamedTuple

import numpy as np
import numpy.typing as npt

from agglom_mpi.analysis.resimulation import (
    is_same,
    mistaken,
    recorded_campaign,
    recorded_parameters,
    recorded_sample,
)
from agglom_mpi.config.campaign import Campaign, load_campaign
from agglom_mpi.formatting import value_with_error
from agglom_mpi.outcome import LEDGER
from agglom_mpi.simulation.sample import Outcome
from agglom_mpi.statistics import mean_of
from agglom_mpi.storage.signature import is_hdf5
from agglom_mpi.variables import NAMES, VARIABLES

if TYPE_CHECKING:
    from agglom_mpi.storage.reader import CampaignData


LEFT_OUT: Final = "objective left out: a function is never run from a campaign file"


class Request(NamedTuple):
    """What to simulate: a campaign with `settings`, or a recorded string or sample of a file.

    With `frames`, so many pictures of one sample are written into the directory `out`.
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


def forward(request: Request, as_json: bool) -> tuple[str, int]:
    """Simulate; the text to print and the exit code, 1 if a sample fails or a replay differs."""
    if request.out is not None:
        from agglom_mpi.report.run_pictures import check_room

        check_room(request.out)
        request = request._replace(sample=request.sample or 0)
    if not is_hdf5(request.source):
        if request.string is not None:
            message = "needs a campaign file FILE.h5, not a YAML file"
            raise mistaken(request.source, "--string", message)
        campaign = load_campaign(request.source, request.allow_code)
        parameters = campaign.parameters(request.settings)
        stored, first, version = None, 0, 0
    else:
        from agglom_mpi.storage.reader import read_inversion

        file = read_inversion(request.source)
        campaign = recorded_campaign(file)
        if request.settings:
            message = "is for YAML files; a recorded string is as it is"
            raise mistaken(request.source, "--set", message)
        parameters, version = recorded_parameters(file, request.string), file.format_version
        stored, first = _stored_sample(request, file), campaign.first_sample(request.string or 0)
    numbers = range(request.samples) if request.sample is None else [request.sample]
    numbers = [first + number for number in numbers]
    engine = campaign.engine(request.engine)
    try:
        seen = request.frames
        campaign.simulate(parameters, numbers[0], engine, seen)  # compiles: seconds are true then
        outcomes = [campaign.simulate(parameters, number, engine, seen) for number in numbers]
    except RuntimeError as error:
        return (json.dumps({"failed": str(error)}) if as_json else str(error)), 1
    report = _report(campaign, parameters, outcomes)
    if campaign.user_function is not None and campaign.user_function.source is None:
        report["note"] = LEFT_OUT
    code = 0
    if stored is not None and request.engine is None:
        same = is_same(stored, outcomes[0].record, version)
        report["replay"] = (
            "identical to the recorded sample" if same else "differs from the recorded sample"
        )
        code = 0 if same else 1
    if request.out is not None:
        report["files"] = _pictures(request, campaign, outcomes[0])
    return (json.dumps(report, indent=2) if as_json else _in_words(report)), code


def _stored_sample(request: Request, file: "CampaignData") -> np.void | None:
    if request.sample is None or request.string is None:
        return None
    return recorded_sample(file, request.string, request.sample)


def _pictures(request: Request, campaign: Campaign, outcome: Outcome) -> list[str]:
    from agglom_mpi.report.run_pictures import write_run

    assert request.out is not None
    assert outcome.frames is not None
    which = "" if request.string is None else f"string {request.string}, "
    title = f"{campaign.title}: {which}sample {request.sample}"
    return write_run(request.out, outcome.frames, campaign.scene.half_width, title)


def _mean(values: list[float]) -> dict[str, float | None]:
    value, error, _ = mean_of(values)
    return {"mean": value, "standard_error": _number(error)}


def _number(value: float) -> float | None:
    return value if math.isfinite(value) else None


def _report(
    campaign: Campaign, parameters: npt.NDArray[np.float64], outcomes: list[Outcome]
) -> dict[str, Any]:
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
        "objective": {"mean": _number(value), "standard_error": _number(error)},
        "measured": measured,
        "ledger": {
            name: max((outcome.ledger[name] for outcome in outcomes), key=abs) for name in LEDGER
        },
    }


def _in_words(report: dict[str, Any]) -> str:
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
