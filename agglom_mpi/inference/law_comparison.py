"""Laws compared: which of several campaigns with the same data explains these.

Each campaign has its evidence (`evidence.py`), and the p-value of its posterior. Probabilities are
those of the campaigns at equal odds, as if one of them were right; the p-values say whether any
is. The predictive density of each datum, left out of the posterior, names the datum and the
experiment that decide (Vehtari, Gelman and Gabry, Stat. Comput. 27, 2017, 1413, through ArviZ).
"""

import importlib.util
import warnings
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any, Final, NamedTuple

import numpy as np

from agglom_mpi.emulation.blas_threads import single_threaded
from agglom_mpi.formatting import without_nan
from agglom_mpi.inference.contributions import datum_points
from agglom_mpi.inference.data_posterior import data_posterior
from agglom_mpi.inference.evidence import Evidence, evidence_of
from agglom_mpi.inference.posterior import Posterior, PosteriorError
from agglom_mpi.inference.telling_apart import TellingMeasurement, telling_measurements
from agglom_mpi.measurements.datum import Datum
from agglom_mpi.measurements.misfit import UNLIKELY, residual_frame
from agglom_mpi.statistics import Floats
from agglom_mpi.storage.recorded_campaign import recorded_campaign

if TYPE_CHECKING:
    import pandas as pd

    from agglom_mpi.storage.reader import CampaignData

DECIDED: Final = 0.95
"""Least probability of a law that data decide for, even if its evidence errs by `SURE` errors."""
SURE: Final = 2.0
MAX_PARETO: Final = 0.7
"""Largest Pareto shape of the weights for which leaving a datum out by them can be trusted."""
SAME: Final = 1e-9
"""Relative difference of two numbers of data that rounding makes."""


class LeftOut(NamedTuple):
    """Log predictive densities of each datum, given the others.

    Attributes
    ----------
    names, experiments
        Of each datum or impact that is left out, and those in which they were measured.
    densities
        Of data in units of their errors, shape (points,).
    pareto
        Shapes of the importance weights, (points,); above `MAX_PARETO` the density is not reliable.
    """

    names: tuple[str, ...]
    experiments: tuple[str, ...]
    densities: Floats
    pareto: Floats

    @property
    def total(self) -> float:
        """Sum of the densities, elpd_loo."""
        return float(self.densities.sum())

    @property
    def unreliable(self) -> int:
        """Number of data whose density is not reliable."""
        return int(np.sum(~(self.pareto <= MAX_PARETO)))

    def as_dict(self) -> dict[str, Any]:
        """Return the densities as plain values."""
        arrays = {"log_densities": self.densities.tolist(), "pareto_shapes": self.pareto.tolist()}
        return {"data": list(self.names), **arrays}


class ComparedLaw(NamedTuple):
    """A campaign among those that are compared.

    Attributes
    ----------
    name
        Of its file, without folder and extension where that is unique.
    posterior, evidence
    left_out
        None without ArviZ.
    """

    name: str
    posterior: Posterior
    evidence: Evidence
    left_out: LeftOut | None

    @property
    def p_value(self) -> float:
        """Posterior predictive p-value of all data together."""
        return self.posterior.p_value

    @property
    def fits(self) -> bool:
        """Whether its data do not contradict it."""
        return self.p_value >= UNLIKELY


@dataclass(frozen=True, repr=False)
class LawComparison:
    """Campaigns with the same data and different laws or scenes; from `agglom_mpi.compare_laws`.

    Attributes
    ----------
    laws
        In the order of the files.
    further
        Measurements that could be made next, the one that tells the two most probable laws apart
        best first; empty unless these data cannot.
    """

    laws: tuple[ComparedLaw, ...]
    further: tuple[TellingMeasurement, ...] = ()

    def __repr__(self) -> str:
        return f"<LawComparison: {self.verdict}>"

    @cached_property
    def probabilities(self) -> Floats:
        """Probability of each law at equal odds, shape (laws,), if one of them is right."""
        return _shares(self._logarithms)

    @property
    def _logarithms(self) -> Floats:
        return np.array([law.evidence.logarithm for law in self.laws])

    @cached_property
    def probabilities_if_doubled(self) -> Floats:
        """Probability of each law if its own box alone were doubled, shape (laws,)."""
        changes = np.diag([law.evidence.box_doubled for law in self.laws])
        return np.array([_shares(self._logarithms + own)[i] for i, own in enumerate(changes)])

    @property
    def order(self) -> list[int]:
        """Places of the laws, the most probable one first."""
        return np.argsort(-self.probabilities, kind="stable").tolist()

    @property
    def best(self) -> ComparedLaw:
        """The most probable law."""
        return self.laws[self.order[0]]

    @property
    def is_decided(self) -> bool:
        """Whether the most probable law fits and has `DECIDED`, also within the errors."""
        first = self.order[0]
        errors = SURE * np.array([law.evidence.error for law in self.laws])
        worst = self._logarithms + errors
        worst[first] -= 2.0 * errors[first]
        resolved = all(law.evidence.is_resolved for law in self.laws)
        return bool(_shares(worst)[first] >= DECIDED and self.best.fits and resolved)

    @property
    def explained(self) -> bool:
        """Whether any law fits the data."""
        return any(law.fits for law in self.laws)

    @property
    def verdict(self) -> str:
        """One-line verdict, without a full stop."""
        first, second = self.order[:2]
        best, other = self.laws[first], self.laws[second]
        stated = f"probability {self.probabilities[first]:.2g}"
        if not self.explained:
            largest = max(law.p_value for law in self.laws)
            return f"none explains the data: every p is below {UNLIKELY:g}, at most {largest:.2g}"
        if self.is_decided:
            doubled = self.probabilities_if_doubled[first]
            doubt = "" if doubled >= DECIDED else f", but {doubled:.2g} if its box were doubled"
            return f"{best.name} explains the data best: {stated}, p = {best.p_value:.2g}{doubt}"
        if not best.fits:
            return (
                f"not decided: {best.name} has {stated}, but does not fit, p = {best.p_value:.2g}"
            )
        advice = "nothing that both predict is expected to tell them apart"
        if self.further and (each := self.further[0]).apart.is_worth_it:
            advice = f"measure {each.name}{' with half of its error' if each.repeats else ''}"
        return (
            f"not decided: these data cannot tell {best.name} from {other.name}, probabilities "
            f"{self.probabilities[first]:.2g} and {self.probabilities[second]:.2g}; {advice}"
        )

    @property
    def _apart(self) -> list[tuple[str, str, float]]:
        """Name, experiment and difference of densities of each datum; empty without ArviZ."""
        first, second = (self.laws[i].left_out for i in self.order[:2])
        if first is None or second is None:
            return []
        apart = (first.densities - second.densities).tolist()
        return list(zip(first.names, first.experiments, apart, strict=True))

    @property
    def deciding(self) -> tuple[str, float] | None:
        """The datum that tells the two most probable laws apart most, and by how much.

        It is the density of the datum left out, of the most probable law less the next. None
        without ArviZ.
        """
        apart = ((name, difference) for name, _, difference in self._apart)
        return max(apart, key=lambda each: abs(each[1]), default=None)

    @property
    def deciding_experiment(self) -> tuple[str, float] | None:
        """The experiment whose data, in sum, tell these laws apart most, and by how much.

        None without ArviZ, and where the data are of one experiment.
        """
        sums = dict.fromkeys((name for _, name, _ in self._apart), 0.0)
        for _, name, difference in self._apart:
            sums[name] += difference
        return max(sums.items(), key=lambda each: abs(each[1])) if len(sums) > 1 else None

    @property
    def table(self) -> "pd.DataFrame":
        """One row for each law, the most probable one first; `records` has the same columns."""
        import pandas as pd

        return pd.DataFrame(self.records())

    @property
    def next_measurements(self) -> "pd.DataFrame":
        """One row for each measurement in `further`, with its numbers in SI units."""
        import pandas as pd

        return pd.DataFrame([each.record() for each in self.further])

    def records(self) -> list[dict[str, Any]]:
        """Return the row of each law as plain values, the most probable one first."""
        return [self._record(self.laws[i], i) for i in self.order]

    def _record(self, law: ComparedLaw, i: int) -> dict[str, Any]:
        found = {
            "law": law.name,
            "probability": float(self.probabilities[i]),
            "probability_if_box_doubled": float(self.probabilities_if_doubled[i]),
            "p_value": law.p_value,
            **law.evidence.as_dict(),
        }
        if (left_out := law.left_out) is not None:
            found["left_out_log_density"] = left_out.total
            found["left_out_unreliable"] = left_out.unreliable
        return found

    def as_dict(self) -> dict[str, Any]:
        """Return the comparison as plain values."""
        found: dict[str, Any] = {
            "verdict": self.verdict,
            "decided": self.is_decided,
            "explained": self.explained,
            "laws": self.records(),
            "left_out": None,
            "next_measurements": [each.record() for each in self.further],
        }
        deciding = {"datum": self.deciding, "experiment": self.deciding_experiment}
        for kind, each in deciding.items():
            key = "deciding" if kind == "datum" else f"deciding_{kind}"
            found[key] = each and {kind: each[0], "log_density_difference": each[1]}
        if known := {law.name: law.left_out.as_dict() for law in self.laws if law.left_out}:
            found["left_out"] = known
        return dict(without_nan(found))


def _shares(logarithms: Floats) -> Floats:
    """Return exp of logarithms over their sum."""
    weights = np.exp(logarithms - logarithms.max())
    return np.asarray(weights / weights.sum())


@single_threaded
def compare_files(files: "Sequence[CampaignData]") -> LawComparison:
    """Compare campaigns with the same data.

    Raises
    ------
    PosteriorError
        If there are fewer than two, a campaign has no posterior or one that fails its check, or
        their data or errors differ.
    """
    if len(files) < 2:
        raise PosteriorError(f"{len(files)} campaign file; at least two are compared")
    campaigns = [recorded_campaign(file) for file in files]
    for file, campaign in zip(files, campaigns, strict=True):
        if not campaign.data or not campaign.objective.needs_data:
            raise PosteriorError(f"{file.path}: objective: must be misfit, of measured data")
        if why := different_data(campaigns[0].data, campaign.data):
            raise PosteriorError(f"{file.path}: data: {why} in {files[0].path}; must be the same")
    posteriors = [file.derived(data_posterior) for file in files]
    stems = [file.path.stem for file in files]
    names = stems if len(set(stems)) == len(stems) else [str(file.path) for file in files]
    for file, posterior in zip(files, posteriors, strict=True):
        if posterior.calibration is not None and not posterior.calibration.passed:
            raise PosteriorError(f"{file.path}: {posterior.calibration.text}")
    found = LawComparison(tuple(map(compared_law, names, posteriors)))
    if found.is_decided or not found.best.fits:
        return found
    two = [found.laws[i] for i in found.order[:2]]
    log_odds = two[0].evidence.logarithm - two[1].evidence.logarithm
    return replace(found, further=telling_measurements([law.posterior for law in two], log_odds))


def compared_law(name: str, posterior: Posterior) -> ComparedLaw:
    """Return a law with the evidence of its data, and with them left out if ArviZ is there."""
    found = evidence_of(posterior.emulated_data, posterior)
    has_arviz = importlib.util.find_spec("arviz") is not None
    return ComparedLaw(name, posterior, found, leave_one_out(posterior) if has_arviz else None)


def different_data(first: Sequence[Datum], second: Sequence[Datum]) -> str:
    """Return how the data of two campaigns differ, in a few words; empty if they do not."""
    if len(first) != len(second):
        return f"{len(second)} data, {len(first)}"
    for mine, other in zip(first, second, strict=True):
        kinds = [(each.quantity, each.own_weight, each.time) for each in (mine, other)]
        arrays = [(each.values, each.edges, each.impacts) for each in (mine, other)]
        if kinds[0] != kinds[1] or not all(map(_equal, *arrays)):
            return f"{other.name} differs from {mine.name}"
    covariances = [residual_frame(tuple(data)).covariance for data in (first, second)]
    return "" if _equal(*covariances) else "errors differ from those"


def _equal(first: Floats | None, second: Floats | None) -> bool:
    if first is None or second is None:
        return first is second
    same_shape = first.shape == second.shape
    return same_shape and np.allclose(first, second, rtol=SAME, atol=0.0, equal_nan=True)


def leave_one_out(posterior: Posterior) -> LeftOut:
    """Return the densities of data that are left out, by smoothed importance weights of ArviZ.

    Raises
    ------
    MissingLibraryError
        If ArviZ is not installed.
    """
    draws = posterior.to_arviz()
    import arviz

    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # unreliable data are counted
        found = arviz.loo(draws, pointwise=True)
    # A pandas.Series; from ArviZ 1 on a record, which has another name for the densities.
    entries = dict(found) if hasattr(found, "items") else vars(found)
    densities = entries["loo_i"] if "loo_i" in entries else entries["elpd_i"]
    points, _ = datum_points(posterior.emulated_data)
    shapes = np.asarray(entries["pareto_k"], np.float64)
    names, experiments = (tuple(each) for each in zip(*(p[:2] for p in points), strict=True))
    return LeftOut(names, experiments, np.asarray(densities, np.float64), shapes)
