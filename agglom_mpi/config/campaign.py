"""The campaign: everything a file says, typed and in SI units."""

import os
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final, Literal

import numpy as np
import numpy.typing as npt

from agglom_mpi.config import describe, identity
from agglom_mpi.config.bounds import Bounds, collect, read_named, required_variables
from agglom_mpi.config.document import read_document
from agglom_mpi.config.ensemble import Ensemble, FinalAnswer, Output, Plan, Stopping
from agglom_mpi.config.objective import Function, Objective
from agglom_mpi.config.scene import Engine, SceneSection, parse_engine
from agglom_mpi.config.search import Search
from agglom_mpi.config.user_function import UserFunction, load_function, read_code
from agglom_mpi.config.yaml_source import (
    CampaignError,
    MissingSearchLibraryError,
    Problem,
    parse,
    read_text,
)
from agglom_mpi.errors import MissingLibraryError, require_library
from agglom_mpi.physics import scales
from agglom_mpi.variables import COUNT, NAMES

if TYPE_CHECKING:
    from agglom_mpi.simulation.sample import Outcome


AGAIN_BITS: Final = 32
"""Samples of a string in one generation are fewer than 2 to this power."""


def load_campaign(path: str | os.PathLike[str], allow_code: bool = False) -> "Campaign":
    """Read a campaign file; a CampaignError lists everything that is wrong with it.

    Parameters
    ----------
    path
        The YAML file.
    allow_code
        Whether the Python function may be run that its objective names, if that is one.
    """
    name = os.fspath(path)
    campaign = Campaign.from_text(read_text(name), name)
    if isinstance(campaign.objective, Function) and not allow_code:
        message = (
            f"is {campaign.objective.call!r}, Python code that is run only if you say so: "
            "--allow-code, or load_campaign(..., allow_code=True)"
        )
        raise campaign.refused_code(message)
    return _with_code(campaign, load_function)


def check_campaign(path: str | os.PathLike[str]) -> "Campaign":
    """Read a campaign file to look at it: what `load_campaign` gives, but no code can be run."""
    name = os.fspath(path)
    campaign = _with_code(Campaign.from_text(read_text(name), name))
    return campaign if campaign.code is None else replace(campaign, code=campaign.code.unread)


def _with_code(
    campaign: "Campaign", run: Callable[[UserFunction], object] = lambda code: None
) -> "Campaign":
    """Read the source of the function that the objective names, if it does, and `run` that."""
    if not isinstance(campaign.objective, Function):
        return campaign
    try:
        code = read_code(Path(campaign.name).parent, campaign.objective.call)
        run(code)
    except ValueError as error:
        raise campaign.refused_code(str(error)) from None
    return replace(campaign, code=code)


@dataclass(frozen=True, eq=False)
class Campaign:
    """A campaign file that has been read; two are the same if their `identity` is.

    Without a `plan` it is a scene alone: all variables are fixed, and nothing is searched. It has
    `code` if its objective is a function.
    """

    title: str
    seed: int
    scene: SceneSection
    variables: Bounds
    objective: Objective
    plan: Plan | None
    output: Output
    final: FinalAnswer | None
    text: str
    name: str
    code: UserFunction | None = None

    @classmethod
    def from_text(
        cls, text: str, name: str = "campaign.yaml", code: UserFunction | None = None
    ) -> "Campaign":
        """Read the YAML text of a campaign that errors call `name`, with the code that it names."""
        document = read_document(text, name)
        return cls(
            title=document.title,
            seed=document.seed,
            scene=document.scene,
            variables=collect(dict(document.variables), tuple(required_variables(document.scene))),
            objective=document.objective,
            plan=document.plan,
            output=document.output,
            final=document.final,
            text=text,
            name=name,
            code=code,
        )

    @property
    def search(self) -> Search:
        """How strings are proposed; a CampaignError without a plan, as for all its parts."""
        return self._planned.search

    @property
    def ensemble(self) -> Ensemble:
        """How many samples a string gets."""
        return self._planned.ensemble

    @property
    def stopping(self) -> Stopping:
        """What ends the campaign."""
        return self._planned.stopping

    @property
    def _planned(self) -> Plan:
        if self.plan is None:
            raise self._nothing_to_search()
        return self.plan

    def _nothing_to_search(self) -> CampaignError:
        line = parse(self.text, self.name).line(("variables",))
        message = "has no range; a search needs at least one variable as [lower, upper]"
        if self.plan is None:
            message += ", and the sections objective, ensemble and stopping"
        return CampaignError(Problem(self.name, line, "variables", message))

    @property
    def common_configurations(self) -> bool:
        """Whether sample k of all strings starts from the same random numbers."""
        return self.plan is not None and self.plan.ensemble.common_configurations

    @property
    def more_samples(self) -> int | None:
        """Samples that a kept parent gets in every generation; None: as published, no more."""
        return self.search.more_samples if self.search.method == "genetic" else None

    def first_sample(self, string: int) -> int:
        """Return the number that `simulate` knows sample 0 of a string of the search by.

        It is 0 but for a parent that gets more samples: they follow on those it had before, which
        never come to so many.
        """
        search = self.search
        if search.method != "genetic" or self.more_samples is None:
            return 0
        generation, slot = divmod(string, search.population)
        return generation << AGAIN_BITS if slot < search.parents else 0

    @property
    def most_strings(self) -> int:
        """Strings evaluated when all generations run."""
        return self.search.strings(self.stopping.generations)

    def given_strings(self) -> npt.NDArray[np.float64]:
        """Return the strings that the file gives to begin with, shape (n, 10)."""
        start = self.search.start
        given = start if isinstance(start, list) else []
        return np.array([self.parameters(values) for values in given]).reshape(-1, COUNT)

    @property
    def most_framed(self) -> tuple[int, int]:
        """Strings, and samples of each, that there are pictures of in the end; at most."""
        frames = self.output.frames
        if frames is None:
            return 0, 0
        samples = min(frames.samples, self.ensemble.max_samples)
        return min(frames.strings, self.most_strings), samples

    def refused_code(self, message: str) -> CampaignError:
        """Return the error that says what is wrong with the function that the objective names."""
        line = parse(self.text, self.name).line(("objective", "call"))
        return CampaignError(Problem(self.name, line, "objective.call", message))

    def check_searchable(self) -> None:
        """Raise a CampaignError unless there is a plan, and a variable to search."""
        if self.plan is None or not self.variables.searched:
            raise self._nothing_to_search()

    def check_libraries(self) -> None:
        """Raise a MissingSearchLibraryError unless the search's library is installed."""
        search = self.search
        if search.library is None:
            return
        try:
            require_library(search.library, "search", f"{search.method} searches")
        except MissingLibraryError as error:
            line = parse(self.text, self.name).line(("search", "method"))
            message = f"is {search.method!r}; {error}"
            problem = Problem(self.name, line, "search.method", message)
            raise MissingSearchLibraryError(problem) from None

    def check_scales(self, string: npt.NDArray[np.float64]) -> None:
        """Raise a CampaignError if a parameter string gives a scene beyond what can be calculated.

        Parameters
        ----------
        string
            All ten variables in SI units.
        """
        value = dict(zip(NAMES, string.tolist(), strict=True))
        problems = []
        for field, measure in (("half_width", scales.grain_mass), ("end_time", scales.end_time)):
            try:
                measure(self.scene, value)
            except ValueError as error:
                line = parse(self.text, self.name).line(("scene", field))
                problems.append(Problem(self.name, line, f"scene.{field}", str(error)))
        if problems:
            raise CampaignError(*problems)

    def with_generations(self, generations: int) -> "Campaign":
        """Return the same campaign with another number of generations; `text` stays as it is."""
        if generations < 1:
            message = f"is {generations}; must be at least 1"
            raise CampaignError(Problem(self.name, None, "stopping.generations", message))
        stopping = self.stopping.model_copy(update={"generations": generations})
        return replace(self, plan=self._planned._replace(stopping=stopping))

    def parameters(
        self,
        values: Mapping[str, float | str] | None = None,
        fill: Literal["lower", "centre", "upper"] = "centre",
    ) -> npt.NDArray[np.float64]:
        """Return one parameter string.

        Parameters
        ----------
        values
            Values by name, SI numbers or texts with units; they may lie outside the search box.
            A variable that the scene does not use is checked and then ignored.
        fill
            What a range becomes for which no value is given.

        Returns
        -------
        numpy.ndarray
            float64 in SI units in the order of `VARIABLES`, nan where the scene uses none.
        """
        share = {"lower": 0.0, "centre": 0.5, "upper": 1.0}[fill]
        string = (1.0 - share) * self.variables.lower + share * self.variables.upper
        problems = []
        for name, value in (values or {}).items():
            try:
                number = read_named(name, value)
            except ValueError as error:
                problems.append(Problem(self.name, None, name, str(error)))
                continue
            if name in self.variables.used:
                string[NAMES.index(name)] = number
        if problems:
            raise CampaignError(*problems)
        return string

    def engine(self, text: str | Engine | None) -> Engine:
        """Engine that `event`, `fixed`, `fixed:STEPS` or `adaptive` means; None: the campaign's."""
        if text is None:
            return self.scene.engine
        if not isinstance(text, str):
            return text
        try:
            return parse_engine(text, self.scene.engine)
        except ValueError as error:
            raise CampaignError(Problem(self.name, None, "engine", str(error))) from None

    def simulate(
        self,
        parameters: Mapping[str, float | str] | npt.ArrayLike,
        sample: int = 0,
        engine: str | Engine | None = None,
        frames: int | Sequence[float] | npt.NDArray[np.float64] | None = None,
    ) -> "Outcome":
        """Simulate one sample exactly as a rank of the campaign does.

        Parameters
        ----------
        parameters
            Values by name, as for `parameters`, or all ten in SI units.
        sample
            Sample number from 0.
        engine
            Another engine than the campaign's, as for `engine`; `event` cools exactly, whatever
            the campaign's `integration` is.
        frames
            How many pictures of the particles to take, evenly spaced from 0 to the end time, or
            their times in s, ascending; they are the outcome's `frames`. Looking does not change
            the outcome. The first time that a kind of scene is looked at, it is compiled anew.
        """
        from agglom_mpi.config.simulate import simulate

        if isinstance(parameters, Mapping):
            string = self.parameters(parameters)
        else:
            string = np.asarray(parameters, dtype=np.float64)
            if string.shape != (COUNT,):
                message = f"have the shape {string.shape}; must be {COUNT} numbers"
                raise CampaignError(Problem(self.name, None, "parameters", message))
        self.check_scales(string)
        times = None if frames is None else self._frame_times(frames, string)
        return simulate(self, string, sample, self.engine(engine), times)

    def _frame_times(self, frames: Any, string: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
        from agglom_mpi.simulation.frames import frame_times

        value = dict(zip(NAMES, string.tolist(), strict=True))
        try:
            return frame_times(frames, scales.end_time(self.scene, value))
        except ValueError as error:
            raise CampaignError(Problem(self.name, None, "frames", str(error))) from None

    def identity(self) -> dict[str, object]:
        """Everything that decides results, flat: `scene.particles` -> 100, in SI units."""
        return identity.identity(self)

    def sha256(self) -> str:
        """Digest of `identity`."""
        return identity.digest(self.identity())

    def describe(self) -> str:
        """Plain text for people: what would run."""
        return describe.text(self)
