"""What a report is made of: the rows of a campaign file, read once, and what follows from them."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np

from agglom_mpi.analysis.estimates import Estimate, objective_of
from agglom_mpi.analysis.ranking import RankedStrings, rank_strings
from agglom_mpi.search.objectives import Objective
from agglom_mpi.search.stopping import StoppingRule
from agglom_mpi.statistics import t_95
from agglom_mpi.storage.reader import CampaignData, Status
from agglom_mpi.variables import NAMES, VARIABLES, Variable

if TYPE_CHECKING:
    from agglom_mpi.config.campaign import Campaign

SYMBOLS = {"growth_target": "Λ", "maximum_growth": "Π"}
"""The papers' names of their objectives [A 26] [B 7.1]."""


@dataclass(frozen=True)
class Material:
    """Rows of a campaign file as they were when it was read; those of `CampaignData`'s methods."""

    file: CampaignData
    status: Status
    generations: np.ndarray
    results: np.ndarray
    samples: np.ndarray
    strings: np.ndarray
    variables: np.ndarray
    legs: np.ndarray
    failures: np.ndarray

    @cached_property
    def identity(self) -> dict[str, Any]:
        """What makes the campaign what it is."""
        return self.file.identity

    @cached_property
    def campaign(self) -> "Campaign":
        """The campaign; of an objective that is a function, without the code.

        Raises
        ------
        CampaignError
            If the text in the file is damaged.
        """
        from agglom_mpi.analysis.resimulation import recorded_campaign

        return recorded_campaign(self.file)

    @cached_property
    def objective(self) -> Objective:
        """The law that samples were judged by."""
        return objective_of(self.file)

    @property
    def objective_label(self) -> str:
        """Name of the objective on an axis, with its unit."""
        symbol = SYMBOLS.get(str(self.identity.get("objective.law")))
        return f"objective {symbol} (1)" if symbol else "objective (1)"

    @cached_property
    def rule(self) -> StoppingRule:
        """The stopping rule of the campaign's ensembles."""
        from agglom_mpi.config.ensemble import ENSEMBLE

        return ENSEMBLE.validate_python(self.file.section("ensemble")).build()

    @cached_property
    def _ranked(self) -> RankedStrings:
        return rank_strings(self.file, self.results, self.strings, self.samples)

    @property
    def estimates(self) -> list[Estimate]:
        """Strings that were estimated again on fresh samples, in order of rank."""
        return self._ranked.estimates

    @property
    def result_of(self) -> dict[int, np.void]:
        """Judgements with a finite objective of strings that are there, by string."""
        return self._ranked.results

    @cached_property
    def string_of(self) -> dict[int, np.void]:
        """Parameter strings by number."""
        return {int(row["string"]): row for row in self.strings}

    @property
    def best(self) -> list[int]:
        """Strings that were judged, the best first; by re-estimates where there are any."""
        return self._ranked.order

    def judged(self, string: int | None) -> int | None:
        """Return a string that is judged, the best one for None; None if there is none at all.

        Raises
        ------
        ValueError
            If it is not judged.
        """
        if string is None:
            return self.best[0] if self.best else None
        if string not in self.result_of:
            raise ValueError(f"string is {string}, which is not judged in {self.file.path}")
        return string

    @property
    def target(self) -> float | None:
        """Mean radius ratio that is asked for, if it is one."""
        if self.identity.get("objective.law") != "growth_target":
            return None
        return float(self.identity["objective.ratio"])

    @cached_property
    def fresh(self) -> int:
        """Number of the first fresh sample of each string."""
        return self.file.fresh_from

    def samples_of(self, string: int) -> np.ndarray:
        """Rows of the samples of one string, by number."""
        first, end = np.searchsorted(self.samples["string"], [string, string + 1])
        return self.samples[first:end]

    @cached_property
    def searched(self) -> list[tuple[Variable, float, float, bool]]:
        """Variables that are searched, their bounds, and whether by their logarithms."""
        return [
            (
                variable,
                float(row["lower"]),
                float(row["upper"]),
                self.identity.get(f"variables.{variable.name}.2") == "log",
            )
            for variable, row in zip(VARIABLES, self.variables, strict=True)
            if row["searched"] == 1
        ]

    def parameters(self, string: int) -> np.ndarray:
        """Return a parameter string by its number, all ten variables in SI units, shape (10,)."""
        return self._table[string]

    def values(self, strings: Sequence[int] | np.ndarray, name: str) -> np.ndarray:
        """Values of a variable of strings by number, nan where the string's row is damaged."""
        at = NAMES.index(name)
        return np.array([self._table.get(int(i), _ABSENT)[at] for i in strings])

    @cached_property
    def _table(self) -> dict[int, np.ndarray]:
        columns = np.column_stack([self.strings[name] for name in NAMES])
        return dict(zip(self.strings["string"].tolist(), columns, strict=True))


_ABSENT = np.full(len(NAMES), np.nan)


def gather(file: CampaignData) -> Material:
    """Read a campaign file, finished or not, also while it is being written."""
    # In an order in which no row of a growing file is read before those that refer to it.
    status, generations, results = file.status(), file.generation_rows(), file.result_rows()
    return Material(
        file=file,
        status=status,
        generations=generations,
        results=results,
        samples=file.all_sample_rows(),
        strings=file.string_rows(),
        variables=file.variable_rows(),
        legs=file.legs(),
        failures=file.failures(),
    )


def half_width(error: np.ndarray, samples: np.ndarray) -> np.ndarray:
    """Half of the 95 % interval by Student's t, of standard errors over so many samples each.

    It is nan below two samples.
    """
    known = [t_95(int(n) - 1) if n > 1 else np.nan for n in np.asarray(samples).tolist()]
    return np.asarray(error, float) * np.array(known, float)
