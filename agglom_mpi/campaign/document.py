"""The campaign file as one typed model, checks between its sections included."""

from typing import Annotated, Any

from pydantic import Field, ValidationError, ValidationInfo, field_validator, model_validator

from agglom_mpi.campaign.explain import explain
from agglom_mpi.campaign.needs import mismatches
from agglom_mpi.campaign.parts import Line, Part, RefusalError, WholeNumber, refuse
from agglom_mpi.campaign.plan import (
    AnyEnsemble,
    AnyObjective,
    GrowthTarget,
    MaximumGrowth,
    Output,
    Plan,
    Search,
    Stopping,
)
from agglom_mpi.campaign.scene import SceneModel
from agglom_mpi.campaign.source import CampaignError, parse
from agglom_mpi.campaign.variables import VariableEntries


class SceneDocument(Part):
    """A scene with the values of its variables: what can be simulated, but not searched.

    The objective is what `agglom simulate` and `agglom accuracy` report beside the growth.
    """

    title: Line = ""
    seed: Annotated[WholeNumber, Field(ge=0, lt=2**63)] = 0
    scene: SceneModel = Field(description="the section on what is simulated")
    variables: VariableEntries = Field(description="the section of values and ranges")
    objective: AnyObjective = MaximumGrowth(law="maximum_growth")
    output: Output = Output()

    @property
    def plan(self) -> Plan | None:
        """What is searched and how; a scene alone has none."""
        return None

    @model_validator(mode="before")
    @classmethod
    def _without_empty_sections(cls, data: Any) -> Any:
        return {key: value for key, value in data.items() if value is not None}

    # Sections are validated in the order above; a section that failed is not in `info.data`.

    @field_validator("variables")
    @classmethod
    def _variables_fit_scene(cls, entries: Any, info: ValidationInfo) -> Any:
        if "scene" in info.data:
            refuse(mismatches(info.data["scene"], dict(entries)))
        return entries

    @field_validator("objective")
    @classmethod
    def _target_is_reachable(cls, objective: Any, info: ValidationInfo) -> Any:
        if "scene" in info.data and isinstance(objective, GrowthTarget):
            particles = info.data["scene"].particles
            largest = particles ** (1.0 / 3.0)
            if objective.ratio > largest:
                message = f"is {objective.ratio:g}; {particles} grains in one give {largest:.4g}"
                raise RefusalError((("ratio",), f"{message}, which is the most"))
        return objective


class Document(SceneDocument):
    """All sections of a campaign, each valid and fitting the others."""

    objective: AnyObjective = Field(description="allowed: growth_target, maximum_growth")
    search: Search = Search()
    ensemble: AnyEnsemble = Field(description="the section on the samples of a string")
    stopping: Stopping = Field(description="the section on what ends the campaign")

    @property
    def plan(self) -> Plan:
        """What is searched and how."""
        return Plan(self.search, self.ensemble, self.stopping)

    @field_validator("stopping")
    @classmethod
    def _top_is_there(cls, stopping: Stopping, info: ValidationInfo) -> Stopping:
        if "search" in info.data and stopping.target is not None:
            population = info.data["search"].population
            if stopping.target.top > population:
                message = f"is {stopping.target.top}; must be at most the population, {population}"
                raise RefusalError((("target", "top"), message))
        return stopping


def read_document(text: str, name: str) -> SceneDocument:
    """Parse and validate the text of a campaign file that errors call `name`."""
    source = parse(text, name)
    model = Document if _is_to_be_searched(source.data) else SceneDocument
    try:
        return model.model_validate(source.data)
    except ValidationError as error:
        raise CampaignError(*explain(error, source, model)) from None


def _is_to_be_searched(data: dict[str, Any]) -> bool:
    """Whether there is a range, or a section that says how to search: then all of these must be."""
    variables = data.get("variables")
    entries = variables.values() if isinstance(variables, dict) else ()
    return any(isinstance(entry, list) for entry in entries) or any(
        data.get(section) is not None for section in Plan._fields
    )
