"""The sections of a campaign, typed and in SI units, and what follows from them alone."""

import math
from contextlib import suppress
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from agglom_mpi.config.bounds import Bounds
from agglom_mpi.config.census_layout import census_layout
from agglom_mpi.config.data_section import DatumEntry
from agglom_mpi.config.plan import FinalAnswer, Output, Plan, Stopping
from agglom_mpi.config.relations import NO_RELATIONS, Relations
from agglom_mpi.config.scene import SceneSection
from agglom_mpi.config.string_scenes import StringScene, StringScenes
from agglom_mpi.config.user_function import UserFunction, function_of_means
from agglom_mpi.config.yaml_source import (
    CampaignError,
    Problem,
    parse,
)
from agglom_mpi.measurements.datum import Datum
from agglom_mpi.measurements.layout import CensusLayout
from agglom_mpi.physics import scales
from agglom_mpi.search.methods.method import SearchMethod
from agglom_mpi.search.objectives.misfit import MeasuredString
from agglom_mpi.search.objectives.objective import Objective
from agglom_mpi.search.space import SearchSpace
from agglom_mpi.search.stopping import StoppingRule
from agglom_mpi.variables import volume_fraction

if TYPE_CHECKING:
    pass


@dataclass(frozen=True, eq=False, repr=False)
class CampaignSections:
    """The sections of a campaign file, and its text.

    The modules that describe, identify and build a campaign are written against this class;
    `campaign.Campaign` adds what people call.

    Attributes
    ----------
    title, seed
        As in the file.
    scene, variables, objective, output, final
        Sections; `final` is None where nothing is estimated again.
    plan
        Sections of a search; None of a scene alone.
    text, name
        Text of the file, and its name in errors.
    user_function
        Source of the objective's function; None where it has none.
    relations
        Derived quantities and constraints.
    volume
        Control volume relative to the box of the file, with as many times the grains.
    data
        Measured data, in the order of the file.
    data_entries
        Section `data`, which they are built from.
    scenes
        The scenes of its strings; see `at`.
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
    user_function: UserFunction | None = None
    relations: Relations = NO_RELATIONS
    volume: int = 1
    data: tuple[Datum, ...] = ()
    data_entries: tuple[DatumEntry, ...] = ()
    scenes: StringScenes = field(init=False)

    def __post_init__(self) -> None:
        of_scene = self.objective.of_grains(self.scene.equivalent_grains)
        of_means = function_of_means(self.user_function, of_scene.code_of_means)
        object.__setattr__(self, "objective", of_scene.with_code(of_means))
        scenes = StringScenes(self.scene, self.variables.table, self.variables.paths, self.volume)
        object.__setattr__(self, "scenes", scenes)

    def at(self, string: npt.ArrayLike) -> StringScene:
        """Return the scene of a string, shape (k,), with the numbers that the string gives.

        Raises
        ------
        ValueError
            If a law refuses its numbers together.
        """
        return self.scenes.at(string)

    def objective_at(self, string: npt.ArrayLike) -> Objective:
        """Return the objective of the samples of a string, which start with its own grains.

        In a larger control volume it is that of the campaign's own number of grains.
        """
        needs_data = self.objective.needs_data
        if not (self.scenes.sizes_differ or needs_data):
            return self.objective
        try:
            section, _ = self.at(string)
        except ValueError:  # a law refuses the string, none of whose samples completes
            return self.objective
        objective = self.objective.of_grains(section.equivalent_grains / self.volume)
        if not needs_data or self.census is None:
            return objective
        return objective.of_string(self.measured_at(string))

    def measured_at(self, string: npt.ArrayLike) -> MeasuredString:
        """Return the data for the samples of a string, and the scales of their censuses.

        Raises
        ------
        ValueError
            If the campaign has no data, or a law refuses the string.
        """
        if self.census is None:
            raise ValueError(f"{self.name} has no section data")
        section, values = self.at(string)
        diameter = 2.0 * scales.grain_radius(section, values)
        return MeasuredString(
            self.data, self.census, diameter, values["density"], section.particles
        )

    @cached_property
    def census(self) -> CensusLayout | None:
        """When samples are counted by size, and in which classes; None without data."""
        return census_layout(self)

    @property
    def search(self) -> SearchMethod:
        """Section `search`; raises a CampaignError for a scene alone."""
        return self.required_plan.search

    @property
    def ensemble(self) -> StoppingRule:
        """Section `ensemble`; raises a CampaignError for a scene alone."""
        return self.required_plan.ensemble

    @property
    def stopping(self) -> Stopping:
        """Section `stopping`; raises a CampaignError for a scene alone."""
        return self.required_plan.stopping

    @property
    def required_plan(self) -> Plan:
        """Sections of the search; raises a CampaignError for a scene alone."""
        if self.plan is None:
            raise self.search_error()
        return self.plan

    def search_error(self) -> CampaignError:
        """Return a CampaignError about a search without ranges, or without its sections."""
        message = "has no range; a search needs at least one variable as [lower, upper]"
        if self.plan is None:
            message += ", and the sections objective, ensemble and stopping"
        return CampaignError(parse(self.text, self.name).problem(("variables",), message))

    @property
    def file_name(self) -> str:
        """Name of the campaign file that a run writes unless it is given another."""
        return self.output.file or f"{Path(self.name).stem}.h5"

    @property
    def common_configurations(self) -> bool:
        """Whether sample k starts from the same random numbers in all strings."""
        return self.plan is not None and self.plan.ensemble.common_configurations

    def first_sample(self, string: int) -> int:
        """Return the number that `simulate` takes for sample 0 of a string of the search."""
        return self.search.first_sample(string)

    @property
    def max_strings(self) -> int:
        """Number of strings evaluated if all generations run."""
        return self.search.strings(self.stopping.generations)

    @property
    def max_framed(self) -> tuple[int, int]:
        """Largest numbers of strings, and of samples of each, whose frames are stored."""
        frames = self.output.frames
        if frames is None:
            return 0, 0
        samples = min(frames.samples, self.ensemble.max_samples)
        return min(frames.strings, self.max_strings), samples

    def space(self) -> SearchSpace:
        """Return the search box, with what the constraints allow of it."""
        space = self.variables.space()
        return space.within(self.allowed_strings) if self.relations.constraints else space

    def fraction(self, size_ratio: float) -> float:
        """Return the share of the box that the grains fill at the start, by their size ratio."""
        return volume_fraction(size_ratio, self.variables.third_moment)

    def allowed_strings(self, strings: npt.NDArray[np.float64]) -> npt.NDArray[np.bool_]:
        """Return which strings, (n, k) in SI units, satisfy the constraints, shape (n,)."""
        return self.relations.allowed(self.scenes, self.variables.table.columns_by_name(strings))

    def derived_values(
        self, strings: npt.NDArray[np.float64]
    ) -> dict[str, npt.NDArray[np.float64]]:
        """Return the derived quantities of strings, (n, k), in SI units, each (n,), by name."""
        return self.relations.values(self.scenes, self.variables.table.columns_by_name(strings))

    @property
    def most_grains(self) -> float:
        """Largest number of grains of the mean radius that have the volume of all in a sample."""
        if not self.scenes.sizes_differ:
            return self.scene.equivalent_grains
        box, found = self.variables, [self.scene.equivalent_grains]
        for string in (box.lower, box.upper):
            with suppress(ValueError):  # no search proposes it
                found.append(self.at(string).section.equivalent_grains)
        return max(found)

    def used_values(self, string: npt.NDArray[np.float64]) -> dict[str, float]:
        """Return the variables of a string, (k,), that the scene uses, by name in SI units."""
        values = self.variables.table.values_by_name(string)
        return {name: value for name, value in values.items() if not math.isnan(value)}

    def used_columns(self, strings: npt.NDArray[np.float64]) -> dict[str, npt.NDArray[np.float64]]:
        """Return the variables of strings, (n, k), that the scene uses, named as in the campaign.

        In place of the size ratio, a campaign may name the volume fraction; each is (n,).
        """
        box, found = self.variables, {}
        for name, values in box.table.columns_by_name(strings).items():
            if name == "size_ratio" and box.by_volume_fraction:
                found["volume_fraction"] = np.array([self.fraction(x) for x in values.tolist()])
            elif name in box.used:
                found[name] = values.copy()
        return found

    def function_error(self, message: str, key: str = "call") -> CampaignError:
        """Return a CampaignError about a function of the objective, with its line."""
        return CampaignError(parse(self.text, self.name).problem(("objective", key), message))

    def check_scales(self, string: npt.NDArray[np.float64]) -> None:
        """Raise a CampaignError if a parameter string gives a grain mass or end time out of range.

        Parameters
        ----------
        string
            The variables in SI units, shape (k,).
        """
        try:
            section, values = self.at(string)
        except ValueError as error:
            raise CampaignError(Problem(self.name, None, "scene", str(error))) from None
        problems = []
        for key, measure in (
            (section.size_key, scales.grain_mass),
            ("end_time", scales.end_time),
        ):
            try:
                measure(section, values)
            except ValueError as error:
                place = ("variables" if key in self.variables.table else "scene", key)
                problems.append(parse(self.text, self.name).problem(place, str(error)))
        if problems:
            raise CampaignError(*problems)
