"""The campaign file as one typed model, with the checks between sections."""

from dataclasses import replace
from functools import cache
from typing import Annotated, Any, Final, Self

import numpy as np
from pydantic import (
    Field,
    ValidationError,
    ValidationInfo,
    create_model,
    field_validator,
    model_validator,
)

from agglom_mpi.config.bounds import (
    VariableEntries,
    check_required,
    entries_model,
    ranges_of,
    required_variables,
    variables_of,
)
from agglom_mpi.config.correlations import Correlation, stated_pairs
from agglom_mpi.config.data_section import (
    DatumEntry,
    impossible_data,
    repeated_data,
    with_curves,
)
from agglom_mpi.config.field_errors import to_campaign_error
from agglom_mpi.config.plan import (
    FinalAnswer,
    Output,
    Plan,
    Stopping,
)
from agglom_mpi.config.relations import quantity_problems, read_constraints, read_derived
from agglom_mpi.config.scene import MAX_PARTICLES, SceneSection
from agglom_mpi.config.scene_paths import PathEntries, read_paths
from agglom_mpi.config.yaml_source import CampaignError, Problem, Source, parse
from agglom_mpi.declaration.choices import Choice
from agglom_mpi.declaration.declared import FieldError, FieldPath, raise_field_errors
from agglom_mpi.declaration.field_types import NONE, Line, WholeNumber
from agglom_mpi.declaration.reading import PLAIN, Reading, reading_of
from agglom_mpi.declaration.sections import Section
from agglom_mpi.physics.sizes import READ_KEYS, reads_file
from agglom_mpi.search.methods.genetic import Genetic
from agglom_mpi.search.methods.method import SearchMethod
from agglom_mpi.search.objectives.growth import MaximumGrowth
from agglom_mpi.search.objectives.objective import Objective
from agglom_mpi.search.stopping import StoppingRule
from agglom_mpi.variables import VariableTable


class SceneDocument(Section):
    """A scene with fixed variables, which can be simulated but not searched.

    `agglom simulate` and `agglom accuracy` report its objective beside the growth.

    Attributes
    ----------
    title
        Title of the campaign in reports.
    seed
        Seed of all random numbers.
    scene
        What is simulated: the box, the grains, and the laws of their impacts.
    variables
        Fixed values and searched ranges of the variables.
    derived
        Quantities computed from the variables, `{pressure: density * relative_speed**2}`.
    constraints
        Conditions that every string must satisfy, `[pressure < 0.1 * hardness]`.
    data
        List of measurements that samples are compared with, each a mapping with its `quantity`.
    correlations
        List of correlations of the errors of `data`, `[{between: [d50, d90], value: 0.6}]`.
    objective
        Number to minimise, such as the distance from a wanted growth.
    output
        Name of the campaign file; optional storage of particles and frames.
    final
        Re-estimate of the best strings on fresh samples; `none` omits it.
    """

    title: Line = ""
    seed: Annotated[WholeNumber, Field(ge=0, lt=2**63)] = 0
    scene: SceneSection = Field(description="the section on what is simulated")
    variables: VariableEntries = Field(description="the section of values and ranges")
    derived: Any = ()
    constraints: Any = ()
    data: tuple[DatumEntry, ...] = ()
    correlations: tuple[Correlation, ...] = ()
    objective: Annotated[Objective, Choice(Objective)] = MaximumGrowth()
    output: Output = Output()
    final: Annotated[FinalAnswer | None, NONE] = FinalAnswer()

    @property
    def plan(self) -> Plan | None:
        """None: nothing is searched."""
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
            scene, table = info.data["scene"], reading_of(info).variables
            ranges = ranges_of(entries, table)
            raise_field_errors(check_required(scene, ranges, table))
        return entries

    @field_validator("derived")
    @classmethod
    def _derived_quantities(cls, entries: Any, info: ValidationInfo) -> Any:
        if "scene" not in info.data:
            return ()
        reading = reading_of(info)
        used = tuple(required_variables(info.data["scene"], reading.variables))
        derived, problems = read_derived(entries, used, reading)
        raise_field_errors(problems)
        return derived

    @field_validator("constraints")
    @classmethod
    def _comparisons(cls, entries: Any, info: ValidationInfo) -> Any:
        if "scene" not in info.data or "derived" not in info.data:
            return ()
        reading = reading_of(info)
        used = tuple(required_variables(info.data["scene"], reading.variables))
        constraints, problems = read_constraints(entries, used, info.data["derived"], reading)
        raise_field_errors(problems)
        return constraints

    @field_validator("data")
    @classmethod
    def _data_fit_scene(
        cls, data: tuple[DatumEntry, ...], info: ValidationInfo
    ) -> tuple[DatumEntry, ...]:
        reading = reading_of(info)
        entries, problems = with_curves(data, reading.files)
        raise_field_errors(problems)
        if "scene" in info.data:
            scene = info.data["scene"]
            differs = scene.end_time == "characteristic" or "end_time" in reading.variables
            end = None if differs else scene.end_time
            raise_field_errors(impossible_data(entries, end, not scene.heating.is_absent))
        return entries

    @model_validator(mode="after")
    def _data_are_independent_or_correlate(self, info: ValidationInfo) -> Self:
        pairs, problems = stated_pairs(self.data, self.correlations)
        raise_field_errors((("correlations", *path), message) for path, message in problems)
        if not reading_of(info).recorded:
            repeated = repeated_data(self.data, self.scene.end_time, pairs)
            raise_field_errors((("data", *path), message) for path, message in repeated)
        if not pairs:
            return self
        of = [{i: r for (i, j), r in pairs.items() if j == k} for k in range(len(self.data))]
        data = tuple(map(DatumEntry.with_correlations, self.data, of))
        return self.model_copy(update={"data": data})

    @field_validator("objective")
    @classmethod
    def _target_is_reachable(cls, objective: Objective, info: ValidationInfo) -> Objective:
        wanted = objective.wanted_growth
        differ = reading_of(info).variables.has_numbers_of("sizes")
        if "scene" in info.data and wanted is not None and not differ:
            (field, ratio), particles = wanted, info.data["scene"].particles
            largest = info.data["scene"].equivalent_grains ** (1.0 / 3.0)
            if ratio > largest:
                message = f"is {ratio:g}; {particles} grains in one give {largest:.4g}"
                raise FieldError((field, f"{message}, which is the most"))
        return objective

    @field_validator("objective")
    @classmethod
    def _quantities_have_columns_of_their_own(
        cls, objective: Objective, info: ValidationInfo
    ) -> Objective:
        names = list(objective.quantity_units)
        problems = quantity_problems(names, info.data.get("derived", ()))
        raise_field_errors((("quantities", *path), message) for path, message in problems)
        return objective

    @field_validator("objective")
    @classmethod
    def _objective_fits_data(cls, objective: Objective, info: ValidationInfo) -> Objective:
        data = info.data.get("data")
        if data is not None and objective.needs_data and not data:
            message = f"is {objective.name!r}, which needs a section data"
            raise FieldError(((objective.named_by,), message))
        if data and not objective.needs_data:
            fitting = [name for name, each in Objective.components().items() if each.needs_data]
            message = f"is {objective.name!r}, which compares nothing with the section data"
            raise FieldError(((objective.named_by,), f"{message}; {', '.join(fitting)} does"))
        return objective

    @field_validator("final")
    @classmethod
    def _volumes_hold_few_enough_grains(
        cls, final: FinalAnswer | None, info: ValidationInfo
    ) -> FinalAnswer | None:
        if final is not None and "scene" in info.data:
            particles = info.data["scene"].particles
            largest = final.volumes[-1]
            if largest > 1 and largest * particles > MAX_PARTICLES:
                message = f"has {largest}; {particles:,} grains in a box allow at most"
                raise FieldError((("volumes",), f"{message} {MAX_PARTICLES // particles}"))
        return final


class CampaignDocument(SceneDocument):
    """All sections of a campaign, checked one by one and against each other.

    Attributes
    ----------
    search
        Method that proposes strings.
    ensemble
        Rule for the number of samples per string.
    stopping
        Criteria that end the search.
    """

    objective: Annotated[Objective, Choice(Objective)] = Field(
        description=f"allowed: {', '.join(Objective.components())}"
    )
    search: Annotated[SearchMethod, Choice(SearchMethod)] = Genetic()
    ensemble: Annotated[StoppingRule, Choice(StoppingRule)] = Field(
        description="the number of samples per string, like {rule: fixed, samples: 10}"
    )
    stopping: Stopping = Field(description="what ends the search, like {generations: 10}")

    @property
    def plan(self) -> Plan:
        """Sections `search`, `ensemble` and `stopping`."""
        return Plan(self.search, self.ensemble, self.stopping)

    @field_validator("search")
    @classmethod
    def _given_strings_are_in_the_box(
        cls, search: SearchMethod, info: ValidationInfo
    ) -> SearchMethod:
        if "variables" in info.data and "scene" in info.data and search.listed:
            entries, table = info.data["variables"], reading_of(info).variables
            box = variables_of(entries, info.data["scene"], table)
            raise_field_errors(check_given_strings(search.listed, box))
        return search

    @field_validator("search")
    @classmethod
    def _set_has_a_target(cls, search: SearchMethod, info: ValidationInfo) -> SearchMethod:
        objective = info.data.get("objective")
        if search.looks_for_a_set and objective is not None and not objective.is_magnitude:
            message = f"is 'set', which needs objective growth_target; it is {objective.name}"
            raise FieldError((("aim",), message))
        return search

    @field_validator("stopping")
    @classmethod
    def _criteria_fit(cls, stopping: Stopping, info: ValidationInfo) -> Stopping:
        others = info.data.get("search"), info.data.get("objective")
        raise_field_errors(
            [
                ((key, *path), message)
                for key, criterion in stopping.criteria.items()
                for path, message in criterion.misfits(*others)
            ]
        )
        return stopping

    @field_validator("ensemble")
    @classmethod
    def _samples_have_objectives(cls, ensemble: StoppingRule, info: ValidationInfo) -> StoppingRule:
        objective = info.data.get("objective")
        rules = None if objective is None else objective.rules
        if objective is not None and rules is not None and ensemble.name not in rules:
            message = f"is {ensemble.name!r}; with objective {objective.name} it must be"
            raise FieldError(((ensemble.named_by,), f"{message} {' or '.join(rules)}"))
        return ensemble

    @field_validator("ensemble")
    @classmethod
    def _races_are_for_parents(cls, ensemble: StoppingRule, info: ValidationInfo) -> StoppingRule:
        if "search" in info.data and ensemble.racing is not None:
            search = info.data["search"]
            if not search.has_parents:
                message = f"is for the parents of a genetic search; {search.name} has none"
                raise FieldError((("racing",), message))
        return ensemble


def read_document(
    text: str, name: str, reading: Reading = PLAIN
) -> tuple[SceneDocument, PathEntries]:
    """Parse and validate the text of the campaign file `name`; raise a CampaignError.

    Returns
    -------
    tuple
        The sections, and the numbers of the scene that stand under `variables`.
    """
    source = parse(text, name)
    if not any(key in CampaignDocument.model_fields for key in source.data):
        # Perhaps a file with somebody's secrets: no key of it is quoted.
        message = "holds none of the sections of a campaign, such as `scene:` and `variables:`"
        raise CampaignError(Problem(name, None, "", message))
    reason = _reason_for_search(source)
    entries = read_paths(_with_sizes(source, reading), reading)
    reading = reading._replace(variables=entries.table)
    model = _model_of(CampaignDocument if reason else SceneDocument, entries.table)
    try:
        document = model.model_validate(entries.source.data, context=reading)
    except ValidationError as error:
        needs: dict[FieldPath, str] = {(section,): reason for section in NEEDED_TO_SEARCH}
        found = to_campaign_error(error, entries.source, model, reading, needs)
        raise entries.error(found) from None
    if entries.problems:
        raise CampaignError(*entries.problems)
    return document, entries


@cache
def _model_of(model: type[SceneDocument], table: VariableTable) -> type[SceneDocument]:
    """Return the model of a file whose section `variables` has the keys of a table."""
    if not table.further:
        return model
    description = model.model_fields["variables"].description
    variables: Any = entries_model(table.further), Field(description=description)
    return create_model(model.__name__, __base__=model, variables=variables)


def _with_sizes(source: Source, reading: Reading) -> Source:
    """Return a file with what is in the file of sizes that its scene may name."""
    data: dict[str, Any] = source.data
    scene: Any = data.get("scene")
    sizes = scene.get("sizes") if isinstance(scene, dict) else None
    if sizes is None:
        return source
    path: FieldPath = ("scene", "sizes")
    problems: list[tuple[FieldPath, str]] = []
    if reads_file(sizes, reading):
        for key in sizes:
            if key not in ("law", "file", "basis"):
                message = f"unknown key '{str(key)[:40]}'; allowed beside file: law, basis"
                problems.append(((*path, str(key)), message))
        try:
            found = reading.files.diameters(sizes["file"])
        except ValueError as error:
            problems.append(((*path, "file"), str(error)))
        else:
            sizes = {**sizes, **dict(zip(READ_KEYS, found, strict=True))}
            data = {**data, "scene": {**scene, "sizes": sizes}}
    if problems:
        raise CampaignError(*(source.problem(where, message) for where, message in problems))
    return replace(source, data=data)


NEEDED_TO_SEARCH: Final = ("objective", "ensemble", "stopping")
"""Sections that a search needs beside its ranges."""


def _reason_for_search(source: Source) -> str:
    """Return what makes a file that of a search, a range or a section; empty for a scene alone."""
    variables = source.data.get("variables")
    for name, entry in variables.items() if isinstance(variables, dict) else ():
        if isinstance(entry, list):
            line = source.line(("variables", name))
            return f"variables.{name}, line {line}, is a range to search"
    for section in Plan._fields:
        if source.data.get(section) is not None:
            line = source.line((section,))
            return f"the section {section}, line {line}, makes this a search"
    return ""


def check_given_strings(
    strings: list[dict[str, float]], box: VariableTable
) -> list[tuple[FieldPath, str]]:
    """Return problems of given strings: values not searched or outside the box, duplicates.

    Parameters
    ----------
    strings
        Values in SI units by name.
    box
        The variables of the campaign with their ranges.
    """
    problems: list[tuple[FieldPath, str]] = []
    for i, string in enumerate(strings):
        if string in strings[:i]:  # equal strings have equal samples, so that nothing is learnt
            problems.append((("start", i), "is the same string as one before it"))
        for name, value in string.items():
            entry, own = box[name], box.as_named(box[name])
            path = ("start", i, own.name)
            if not entry.is_searched:
                problems.append((path, "is not searched; give values of variables with a range"))
            elif not entry.lower <= value <= entry.upper:
                [given] = own.of_components(np.array([value]))
                message = f"is {given:g}; must be within its range, {own.lower:g} to {own.upper:g}"
                problems.append((path, message))
    return problems
