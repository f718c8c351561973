"""The campaign file as one typed model, checks between its sections included."""

from collections.abc import Mapping
from typing import Annotated, Any

from pydantic import Field, ValidationError, ValidationInfo, field_validator, model_validator

from agglom_mpi.config.bounds import Range, VariableEntries, check_required
from agglom_mpi.config.ensemble import (
    NONE,
    AnyEnsemble,
    Ensemble,
    FinalAnswer,
    Output,
    Plan,
    Stopping,
)
from agglom_mpi.config.objective import (
    LAWS,
    AnyObjective,
    Function,
    GrowthTarget,
    MaximumGrowth,
    Moments,
)
from agglom_mpi.config.scene import SceneSection
from agglom_mpi.config.search import AnySearch, Genetic, Search
from agglom_mpi.config.validation import (
    FieldError,
    Line,
    Section,
    WholeNumber,
    explain,
    raise_field_errors,
)
from agglom_mpi.config.yaml_source import CampaignError, Path, parse


class SceneDocument(Section):
    """A scene with the values of its variables: what can be simulated, but not searched.

    The objective is what `agglom simulate` and `agglom accuracy` report beside the growth.
    """

    title: Line = ""
    seed: Annotated[WholeNumber, Field(ge=0, lt=2**63)] = 0
    scene: SceneSection = Field(description="the section on what is simulated")
    variables: VariableEntries = Field(description="the section of values and ranges")
    objective: AnyObjective = MaximumGrowth(law="maximum_growth")
    output: Output = Output()
    final: Annotated[FinalAnswer | None, NONE] = FinalAnswer()

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
            raise_field_errors(check_required(info.data["scene"], dict(entries)))
        return entries

    @field_validator("objective")
    @classmethod
    def _target_is_reachable(cls, objective: Any, info: ValidationInfo) -> Any:
        field, ratio = _mean_wanted(objective)
        if "scene" in info.data and ratio is not None:
            particles = info.data["scene"].particles
            largest = particles ** (1.0 / 3.0)
            if ratio > largest:
                message = f"is {ratio:g}; {particles} grains in one give {largest:.4g}"
                raise FieldError((field, f"{message}, which is the most"))
        return objective


def _mean_wanted(objective: Any) -> tuple[Path, float | None]:
    """Where an objective says which mean b/b0 it wants, and which; None if it does not."""
    match objective:
        case GrowthTarget():
            return ("ratio",), objective.ratio
        case Moments():
            return ("targets", "mean"), objective.targets.mean
    return (), None


class CampaignDocument(SceneDocument):
    """All sections of a campaign, each valid and fitting the others."""

    objective: AnyObjective = Field(description=f"allowed: {LAWS}")
    search: AnySearch = Genetic()
    ensemble: AnyEnsemble = Field(description="the section on the samples of a string")
    stopping: Stopping = Field(description="the section on what ends the campaign")

    @property
    def plan(self) -> Plan:
        """What is searched and how."""
        return Plan(self.search, self.ensemble, self.stopping)

    @field_validator("search")
    @classmethod
    def _given_strings_are_in_the_box(cls, search: Search, info: ValidationInfo) -> Search:
        if "variables" in info.data and isinstance(search.start, list):
            raise_field_errors(check_given_strings(search.start, dict(info.data["variables"])))
        return search

    @field_validator("ensemble")
    @classmethod
    def _races_are_for_parents(cls, ensemble: Ensemble, info: ValidationInfo) -> Ensemble:
        if "search" in info.data and ensemble.racing is not None:
            method = info.data["search"].method
            if method != "genetic":
                message = f"is for the parents of a genetic search; {method} has none"
                raise FieldError((("racing",), message))
        return ensemble

    @field_validator("stopping")
    @classmethod
    def _top_is_there(cls, stopping: Stopping, info: ValidationInfo) -> Stopping:
        if "search" in info.data and stopping.target is not None:
            population = info.data["search"].population
            if stopping.target.top > population:
                message = f"is {stopping.target.top}; must be at most the population, {population}"
                raise FieldError((("target", "top"), message))
        return stopping

    @field_validator("stopping")
    @classmethod
    def _target_has_a_sign(cls, stopping: Stopping, info: ValidationInfo) -> Stopping:
        """Only a user's own function may be less than 0."""
        objective, target = info.data.get("objective"), stopping.target
        own = objective is None or isinstance(objective, Function)
        if target is not None and target.objective < 0.0 and not own:
            message = f"is {target.objective:g}; must be at least 0"
            raise FieldError((("target", "objective"), message))
        return stopping


def read_document(text: str, name: str) -> SceneDocument:
    """Parse and validate the text of a campaign file that errors call `name`."""
    source = parse(text, name)
    model = CampaignDocument if _is_to_be_searched(source.data) else SceneDocument
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


def check_given_strings(
    strings: list[dict[str, float]], entries: Mapping[str, Range | None]
) -> list[tuple[Path, str]]:
    """Values of given strings that are not searched, or not in the box; strings given twice."""
    problems: list[tuple[Path, str]] = []
    for i, string in enumerate(strings):
        if string in strings[:i]:  # equal strings have equal samples, from which nothing is learnt
            problems.append((("start", i), "is the same string as one before it"))
        for name, value in string.items():
            entry, path = entries[name], ("start", i, name)
            if entry is None or entry.lower == entry.upper:
                problems.append((path, "is not searched; give values of variables with a range"))
            elif not entry.lower <= value <= entry.upper:
                ends = f"{entry.lower:g} to {entry.upper:g}"
                problems.append((path, f"is {value:g}; must be within its range, {ends}"))
    return problems
