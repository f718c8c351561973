"""Estimate of one parameter string: mean ± standard error of what is measured of its samples."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from agglom_mpi.config.campaign import Campaign
from agglom_mpi.config.given_strings import read_string
from agglom_mpi.config.quantities import columns_of
from agglom_mpi.formatting import format_mean, in_unit, pluralise, value_with_error, without_nan
from agglom_mpi.outcome import LEDGER, SPIN_UNITS
from agglom_mpi.physics.scales import half_width
from agglom_mpi.public_face import PublicFace
from agglom_mpi.search.objectives.moment_targets import interval_notes
from agglom_mpi.search.objectives.objective import ReachedMoment
from agglom_mpi.simulation.engines import Engine
from agglom_mpi.simulation.sample import Outcome
from agglom_mpi.statistics import MeanEstimate, mean_of, without_rounding
from agglom_mpi.variables import PAPER_VARIABLES
from agglom_mpi.verbs.simulate import simulate

MEASURED: Final = {
    "mean_radius_ratio": "mean_radius_ratio",
    "radius_spread": "radius_spread",
    "particles_left": "particles_left",
    "temperature": "temperature_K",
    "collisions": "collisions",
    "merges": "merges",
    "breakups": "breakups",
    "steps": "steps",
    "seconds": "seconds",
    "cpu_seconds": "cpu_seconds",
}
"""Attributes of a `StringEstimate` that are means over samples, and their names in JSON."""

MISSING: Final = MeanEstimate(math.nan, math.nan, 0)
"""Estimate of what the scene lacks."""

GROWN: Final = (
    "overlaps: pairs of particles at the end in which an aggregate has grown into its neighbour; "
    "they collide as soon as they approach"
)
"""Explanation of the last line of a ledger."""
MISSED: Final = (
    "overlaps: pairs of particles at the end whose impact a time step has missed, as none has grown"
)
"""The same where no particles merge or break."""


@dataclass(frozen=True, repr=False)
class StringEstimate(metaclass=PublicFace):
    """Means over the completed samples of a string, with standard errors.

    `campaign.estimate` returns it. Each mean is a `MeanEstimate` with `value`, `error` and
    `samples`; `print` shows all of them as `agglom simulate` does.

    Attributes
    ----------
    parameters : dict
        Variables that the scene uses, SI units.
    derived : dict
        Of each derived column its value and SI unit.
    samples, failed : int
        Completed samples, and those that failed, which are left out.
    objective : MeanEstimate
        The campaign's objective of the samples together; nan if that is a function whose code was
        not allowed.
    mean_radius_ratio, radius_spread : MeanEstimate
        Of each sample the mean and the standard deviation of b/b⁰ over the particles left.
    particles_left, temperature : MeanEstimate
        Number of particles left, and their mean temperature by mass in K, nan of no samples where
        the scene has none.
    collisions, merges, breakups, steps : MeanEstimate
        Counts of a sample.
    seconds, cpu_seconds : MeanEstimate
        Wall-clock and processor time of a sample, s.
    moments : tuple of ReachedMoment
        Where the objective has targets for moments: each with what was reached.
    ledger : dict
        Of each column of the ledger the worst sample's.
    quantities : dict
        Mean of each quantity that the objective's function returns, and of those of spins, in SI
        units.
    quantity_units : dict
        Their SI units.
    volume_fraction : MeanEstimate or None
        Where grains have different sizes: share of the box that the drawn grains of the completed
        samples fill. It is lower than the volume fraction of `parameters` where samples with large
        grains find no place for them and fail.
    units : dict
        SI units of the parameters beside those of the papers, by name.
    """

    parameters: dict[str, float]
    derived: dict[str, tuple[float, str]]
    samples: int
    failed: int
    objective: MeanEstimate
    mean_radius_ratio: MeanEstimate
    radius_spread: MeanEstimate
    particles_left: MeanEstimate
    temperature: MeanEstimate
    collisions: MeanEstimate
    merges: MeanEstimate
    breakups: MeanEstimate
    steps: MeanEstimate
    seconds: MeanEstimate
    cpu_seconds: MeanEstimate
    moments: tuple[ReachedMoment, ...]
    ledger: dict[str, float]
    volume_fraction: MeanEstimate | None
    units: dict[str, str]
    quantities: dict[str, MeanEstimate] = field(default_factory=dict)
    quantity_units: dict[str, str] = field(default_factory=dict)

    def as_dict(self) -> dict[str, Any]:
        """Return the estimate as plain values for JSON; nan and inf become None."""
        means = {name: getattr(self, name) for name in MEASURED}
        found = {
            "parameters": self.parameters,
            "derived": {
                name: {"value": without_nan(value), "unit": unit}
                for name, (value, unit) in self.derived.items()
            },
            "samples": self.samples,
            "failed": self.failed,
            "objective": _plain(self.objective),
            "measured": {MEASURED[name]: _plain(mean) for name, mean in means.items()},
            "ledger": self.ledger,
        }
        if self.volume_fraction is not None:
            found["volume_fraction"] = _plain(self.volume_fraction)
        if self.quantities:
            found["quantities"] = {
                name: _plain(mean) | {"unit": self.quantity_units[name]}
                for name, mean in self.quantities.items()
            }
        if self.moments:
            found["moments"] = {m.name: m.as_dict() for m in self.moments}
        return found

    def __repr__(self) -> str:
        means = {"mean_radius_ratio": self.mean_radius_ratio, "objective": self.objective}
        text = ", ".join(f"{name} {format_mean(mean)}" for name, mean in means.items())
        failed = f", {self.failed} failed" if self.failed else ""
        return f"<StringEstimate of {pluralise(self.samples, 'sample')}{failed}: {text}>"

    def __str__(self) -> str:
        """Return the estimate as lines for the terminal."""
        return "\n".join(self._lines())

    def _lines(self) -> list[str]:
        units = {variable.name: variable.unit for variable in PAPER_VARIABLES} | self.units
        lines = ["parameters"]
        lines += [_line(name, value, units[name]) for name, value in self.parameters.items()]
        if self.derived:
            lines.append("derived")
        lines += [_line(name, value, unit) for name, (value, unit) in self.derived.items()]
        one = "result of 1 sample, without a standard error"
        several = f"mean ± standard error over {self.samples} samples"
        lines.append(one if self.samples == 1 else several)
        means = {"objective": self.objective}
        means |= {label: getattr(self, name) for name, label in MEASURED.items()}
        lines += [
            f"  {label:<22}{value_with_error(m.value, m.error)}"
            for label, m in means.items()
            if m.samples
        ]
        for name, mean in self.quantities.items():
            unit = self.quantity_units[name]
            label = name if unit == "1" else f"{name}_{unit}"
            lines.append(f"  {label + ' ':<22}{value_with_error(mean.value, mean.error)}")
        if (filled := self.volume_fraction) is not None:
            lines.append(f"  {'volume fraction':<22}{value_with_error(filled.value, filled.error)}")
        if self.moments:
            lines.append("targets")
            lines += [f"  {moment.name:<22}{moment}" for moment in self.moments]
            lines += interval_notes(moment.name for moment in self.moments if moment.error >= 0.0)
        if self.failed:
            simulated = pluralise(self.samples + self.failed, "sample")
            lines.append(f"{self.failed} of {simulated} failed")
        lines.append("ledger, worst sample")
        lines += [f"  {name:<22}{value:.3g}" for name, value in self.ledger.items()]
        changed = self.merges.value > 0.0 or self.breakups.value > 0.0
        return [*lines, GROWN if changed else MISSED] if self.ledger["overlaps"] else lines


def _line(name: str, value: float, unit: str) -> str:
    return in_unit(f"  {name:<22}{value:.6g}", unit)


def _plain(mean: MeanEstimate) -> dict[str, float | None]:
    return {"mean": without_nan(mean.value), "standard_error": without_nan(mean.error)}


def estimate(
    campaign: Campaign,
    parameters: Mapping[str, float | str] | npt.ArrayLike,
    samples: int = 100,
    engine: str | Engine | None = None,
) -> StringEstimate:
    """Return the estimate of a string from its samples 0, 1, …; see `RunnableCampaign.estimate`."""
    samples = campaign.count("samples", samples, least=1)
    string, outcomes, failures = read_string(campaign, parameters), [], []
    for sample in range(samples):
        try:
            outcomes.append(simulate(campaign, string, sample, engine))
        except RuntimeError as error:
            failures.append(error)
    if not outcomes:
        raise failures[0]
    return estimate_of(campaign, string, outcomes, len(failures))


def estimate_of(
    campaign: Campaign,
    parameters: npt.NDArray[np.float64],
    outcomes: Sequence[Outcome],
    failed: int = 0,
) -> StringEstimate:
    """Return the estimate of a string from its completed samples, at least one.

    Parameters
    ----------
    campaign
    parameters
        The variables in SI units, shape (k,).
    outcomes
        Of `campaign.simulate`.
    failed
        Number of samples that failed.
    """
    objective, table = campaign.objective_at(parameters), campaign.variables
    summaries = [outcome.measured for outcome in outcomes]
    value, error = objective.of_ensemble(summaries)
    rounding = objective.rounding(value)
    used = campaign.variables.used
    records = [outcome.record for outcome in outcomes]

    def mean(name: str) -> MeanEstimate:
        return mean_of([float(record[name]) for record in records])

    return StringEstimate(
        parameters={n: v for n, v in table.values_by_name(parameters).items() if n in used},
        derived={
            column.name: (float(column.values[0]), column.unit)
            for column in columns_of(campaign, parameters[None])
        },
        samples=len(outcomes),
        failed=failed,
        objective=MeanEstimate(
            without_rounding(value, rounding), without_rounding(error, rounding), len(outcomes)
        ),
        mean_radius_ratio=mean("mean_radius_ratio"),
        radius_spread=mean_of([math.sqrt(outcome.moments[1]) for outcome in outcomes]),
        particles_left=mean("particles"),
        temperature=mean("mean_temperature") if "temperature" in used else MISSING,
        collisions=mean("collisions"),
        merges=mean("merges"),
        breakups=mean("breakups"),
        steps=mean("steps"),
        seconds=mean_of([outcome.seconds for outcome in outcomes]),
        cpu_seconds=mean_of([outcome.cpu_seconds for outcome in outcomes]),
        moments=objective.reached(summaries),
        ledger={name: max((o.ledger[name] for o in outcomes), key=abs) for name in LEDGER},
        volume_fraction=_filled(campaign, parameters, outcomes),
        units={variable.name: variable.unit for variable in table.further},
        quantities={
            name: mean(name)
            if name in SPIN_UNITS
            else mean_of([outcome.quantities[name] for outcome in outcomes])
            for name in campaign.sample_quantities
        },
        quantity_units=campaign.sample_quantities,
    )


def _filled(
    campaign: Campaign, parameters: npt.NDArray[np.float64], outcomes: Sequence[Outcome]
) -> MeanEstimate | None:
    """Return the volume fraction of the grains of completed samples; None if all are equal.

    By the mass at the end, which is that of the start.
    """
    if campaign.scene.size_law is None:
        return None
    section, value = campaign.at(parameters)
    volume = (2.0 * half_width(section, value)) ** 3
    masses = [float(outcome.final.masses.sum()) for outcome in outcomes]
    return mean_of([mass / (value["density"] * volume) for mass in masses])
