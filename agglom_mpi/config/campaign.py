"""A campaign: everything that its file states, typed and in SI units."""

from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import Any, Final, Literal

import numpy as np
import numpy.typing as npt

from agglom_mpi.config import describe, identity
from agglom_mpi.config.arguments import count_argument
from agglom_mpi.config.bounds import variables_of
from agglom_mpi.config.census_layout import census_layout, measured
from agglom_mpi.config.data_section import DatumEntry, built_data
from agglom_mpi.config.document import EXPERIMENTS, parse_campaign, read_document
from agglom_mpi.config.experiments import (
    CampaignExperiment,
    campaign_of_experiments,
    in_seed,
    joint_warnings,
    named_experiment,
    needs_one_scene,
)
from agglom_mpi.config.given_strings import Parameters, read_string, read_strings
from agglom_mpi.config.plan import FinalAnswer, Output, Plan, Stopping
from agglom_mpi.config.relations import NO_RELATIONS, Relations
from agglom_mpi.config.scene import SceneSection, parse_engine
from agglom_mpi.config.searchable import check_ends, check_scales, check_start, refused_corners
from agglom_mpi.config.string_scenes import FirstExperimentScenes, StringScene, StringScenes
from agglom_mpi.config.user_function import UserFunction, function_of_means
from agglom_mpi.config.yaml_source import ArgumentError, CampaignError, Problem, parse, with_seed
from agglom_mpi.declaration.reading import PLAIN, Reading
from agglom_mpi.measurements.datum import Datum
from agglom_mpi.measurements.layout import Layouts, prefix_of
from agglom_mpi.outcome import SPIN_UNITS
from agglom_mpi.physics.impact_tests import ImpactTests, impact_tests
from agglom_mpi.public_face import PublicFace
from agglom_mpi.search.methods.method import SearchMethod
from agglom_mpi.search.objectives.misfit import Measured
from agglom_mpi.search.objectives.objective import Objective
from agglom_mpi.search.space import SearchSpace
from agglom_mpi.search.stopping import StoppingRule
from agglom_mpi.simulation.engines import Engine
from agglom_mpi.variables import VariableTable

PUBLIC: Final = (
    *("title", "seed", "text", "name", "allowed", "warnings", "in_volume", "parameters"),
    *("identity", "sha256", "description", "describe"),
)
"""Names of a campaign for users; others are sections, and what builds or checks a run."""


@dataclass(frozen=True, eq=False, repr=False)
class Campaign(metaclass=PublicFace, public=PUBLIC):
    """A validated campaign; equal campaigns have equal `identity`.

    `agglom_mpi.load_campaign(path)` returns one that can be simulated and run, too.

    Attributes
    ----------
    title : str
        Title of the campaign.
    seed : int
        Seed of all random streams.
    text, name : str
        Text of the file, and its name in errors.
    """

    title: str
    seed: int
    scene: SceneSection
    variables: VariableTable
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
    experiments: tuple[CampaignExperiment, ...] = ()
    has_layout: bool = False
    stored_census: Layouts | None = None
    scenes: StringScenes = field(init=False)

    def __post_init__(self) -> None:
        of_scene = self.objective.of_grains(self.scene.equivalent_grains)
        of_means = function_of_means(self.user_function, of_scene.code_of_means)
        object.__setattr__(self, "objective", of_scene.with_code(of_means))
        scenes = StringScenes(self.scene, self.variables, self.volume)
        if self.experiments:
            scenes = FirstExperimentScenes(self.variables, self.experiments[0])
        object.__setattr__(self, "scenes", scenes)

    def __repr__(self) -> str:
        return f"<Campaign {self.name!r}: {describe.in_a_few_words(self)}>"

    @classmethod
    def from_text(
        cls,
        text: str,
        name: str = "campaign.yaml",
        user_function: UserFunction | None = None,
        reading: Reading = PLAIN,
    ) -> "Campaign":
        """Return the campaign of a YAML text; `name` stands for the file in errors.

        `reading` finds components of one's own and files of sizes, and reads a text that a run
        recorded as it was read then.
        """
        source = parse_campaign(text, name)
        if source.data.get(EXPERIMENTS) is not None:
            return campaign_of_experiments(cls, source, text, reading)
        document, entries = read_document(source, reading)
        campaign = cls(
            **document.for_campaign,
            scene=document.scene,
            variables=variables_of(document.variables, document.scene, entries.table),
            data=built_data(document.data),
            data_entries=document.data,
            text=text,
            name=name,
            user_function=user_function,
            relations=Relations(document.derived, document.constraints),
        )
        check_ends(campaign)
        if campaign.plan is not None:
            check_start(campaign, campaign.given_strings())
        return campaign

    def given_strings(self) -> npt.NDArray[np.float64]:
        """Return the strings that `search.start` lists, in SI units, shape (n, k)."""
        strings = [self.parameters(values) for values in self.search.listed]
        return np.array(strings).reshape(-1, self.variables.count)

    def allowed(self, parameters: Parameters) -> npt.NDArray[np.bool_]:
        """Return which of n strings satisfy the constraints, shape (n,); the box does not matter.

        Parameters
        ----------
        parameters
            Values by name, numbers in SI units or texts with units, each (n,) or one for all; what
            is not given is fixed, or the middle of its range. Or all variables of the campaign in
            SI units, shape (k,) or (n, k).

        Raises
        ------
        CampaignError
            If a name is unknown or a value impossible.
        """
        return self.allowed_strings(read_strings(self, parameters))

    def warnings(self, parameters: Mapping[str, float | str] | None = None) -> list[Problem]:
        """Return what is unlikely in the campaign, or in one string of it; `str` of each is a line.

        Parameters
        ----------
        parameters
            Values of a string as for `parameters`; None: the whole search box.

        Raises
        ------
        CampaignError
            If a name is unknown or a value impossible.
        """
        from agglom_mpi.config.plausibility import implausible

        if self.experiments:
            return joint_warnings(self, parameters)
        corners = refused_corners(self) if parameters is None and self.variables.of_scene else []
        return implausible(self, parameters) + corners

    def with_seed(self, seed: int) -> "Campaign":
        """Return the campaign with another seed, which its `text` has, too."""
        seed = self.count("seed", seed)
        own = tuple(in_seed(each, seed) for each in self.experiments)
        text = with_seed(self.text, self.name, seed)
        return replace(self, seed=seed, text=text, experiments=own)

    def with_generations(self, generations: int) -> "Campaign":
        """Return the campaign with another number of generations; its `text` is unchanged."""
        generations = self.count("stopping.generations", generations, least=1)
        stopping = self.stopping.model_copy(update={"generations": generations})
        return replace(self, plan=self.required_plan._replace(stopping=stopping))

    def in_volume(self, volume: int) -> "Campaign":
        """Return the campaign in `volume` times the control volume, with as many times the grains.

        The size of the grains and the volume fraction stay the same, and the objective is still
        that of the campaign's own number of grains. `simulate` of the result gives the samples of
        larger volumes that `final: {volumes: …}` asks for. `text` and `identity` are unchanged.
        """
        if volume != 1:
            self.require_one_scene("in_volume")
        return replace(self, volume=self.count("volume", volume, least=1))

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
            `volume_fraction` may stand in place of `size_ratio`.
            A variable that the scene does not use is checked and then ignored.
        fill
            Which value of its range a variable takes that is not in `values`.

        Returns
        -------
        numpy.ndarray
            The variables in SI units, shape (k,): relative_speed, size_ratio, density, hardness,
            heat_capacity, friction, temperature, activation_energy, reaction_heat, surface_energy,
            then numbers of the scene by the order of their paths; nan where the scene does not use
            one.

        Raises
        ------
        CampaignError
            If a name is unknown or a value impossible.
        """
        return read_string(self, values or {}, {"lower": 0.0, "centre": 0.5, "upper": 1.0}[fill])

    def engine(self, text: str | Engine | None) -> Engine:
        """Return the engine `event`, `fixed`, `fixed:STEPS` or `adaptive`; for None the scene's."""
        if text is None:
            return self.scene.engine
        engine = text
        if isinstance(engine, str):
            try:
                engine = parse_engine(engine, self.scene.engine)
            except ValueError as error:
                raise CampaignError(Problem(self.name, None, "engine", str(error))) from None
        if not isinstance(engine, Engine):
            message = f"is {text!r}; must be event, fixed, fixed:STEPS or adaptive"
            raise ArgumentError.of(self.name, "engine", message)
        if message := self.scene.refused(engine):
            raise CampaignError(Problem(self.name, None, "engine", message))
        return engine

    def count(self, field: str, value: Any, least: int = 0) -> int:
        """Return a whole number of at least `least`, given as an argument `field`."""
        return count_argument(self.name, field, value, least)

    def identity(self) -> dict[str, object]:
        """Return all that decides results, flat: `scene.particles` -> 100, in SI units."""
        return identity.identity(self)

    def sha256(self) -> str:
        """Return the SHA-256 of `identity` as 64 hexadecimal digits."""
        return identity.digest(self.identity())

    def description(self) -> dict[str, object]:
        """Return what `describe` says, by headings, and the identity, as plain values for JSON."""
        return describe.as_dict(self)

    def describe(self) -> str:
        """Return a plain text on what would run, as `agglom check` prints it."""
        return describe.text(self)

    def at(self, string: npt.ArrayLike) -> StringScene:
        """Return the scene of a string, shape (k,), with the numbers that the string gives.

        Of a campaign with experiments it is that of the first one.

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
        if self.experiments:
            with suppress(ValueError):  # a law refuses the string
                return self.objective.of_string(self.measured_at(string))
            return self.objective
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

    def measured_at(self, string: npt.ArrayLike) -> Measured:
        """Return the data for the samples of a string, and the scales of their censuses.

        Raises
        ------
        ValueError
            If the campaign has no data, or a law refuses the string.
        """
        return measured(self, string)

    def impact_tests_at(self, string: npt.ArrayLike, experiment: str = "") -> ImpactTests:
        """Return the laws of single impacts of a string; raise a ValueError if one refuses it."""
        if experiment:
            own = self.of_experiment(experiment)
            return own.campaign.impact_tests_at(own.own(string))
        return impact_tests(*self.at(string))

    def of_experiment(self, name: str) -> CampaignExperiment:
        """Return an experiment by its name; raise an ArgumentError if there is none."""
        return named_experiment(self, name)

    def require_one_scene(self, field: str) -> None:
        """Raise an ArgumentError of a campaign that has experiments, each with a scene."""
        if self.experiments:
            raise needs_one_scene(self, field)

    @cached_property
    def census(self) -> Layouts | None:
        """When samples are counted by size, and in which classes, as in its file; or None."""
        return self.stored_census or census_layout(self)

    @property
    def sample_quantities(self) -> dict[str, str]:
        """SI units of what samples have beside the columns of all: by a function, and of spins."""
        scenes = {prefix_of(each.name): each.campaign.scene for each in self.experiments}
        found = dict(self.objective.quantity_units)
        for prefix, scene in (scenes or {"": self.scene}).items():
            if scene.has_spins:
                found |= {f"{prefix}{name}": unit for name, unit in SPIN_UNITS.items()}
        return found

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
        space = SearchSpace.of(self.variables)
        return space.within(self.allowed_strings) if self.relations.constraints else space

    def allowed_strings(self, strings: npt.NDArray[np.float64]) -> npt.NDArray[np.bool_]:
        """Return which strings, (n, k) in SI units, satisfy the constraints, shape (n,)."""
        return self.relations.allowed(self.scenes, self.variables.columns_by_name(strings))

    def derived_values(
        self, strings: npt.NDArray[np.float64]
    ) -> dict[str, npt.NDArray[np.float64]]:
        """Return the derived quantities of strings, (n, k), in SI units, each (n,), by name."""
        return self.relations.values(self.scenes, self.variables.columns_by_name(strings))

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

    def function_error(self, message: str, key: str = "call") -> CampaignError:
        """Return a CampaignError about a function of the objective, with its line."""
        return CampaignError(parse(self.text, self.name).problem(("objective", key), message))

    def check_scales(self, string: npt.NDArray[np.float64]) -> None:
        """Raise a CampaignError if a string, (k,), gives a grain mass or end time out of range."""
        check_scales(self, string)
