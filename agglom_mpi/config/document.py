"""The campaign file as one typed model, with the checks between sections."""

from collections.abc import Mapping
from dataclasses import replace
from typing import Annotated, Any, ClassVar, Final

from agglom_mpi.config.bounds import (
    check_required,
    ranges_of,
    read_entries,
    required_variables,
    variables_of,
)
from agglom_mpi.config.correlations import Correlation, correlated
from agglom_mpi.config.data_section import (
    DatumEntry,
    fixed_end,
    impossible_data,
    late,
    read_data,
)
from agglom_mpi.config.plan import CertificatePlan, FinalAnswer, Output, Plan, Stopping
from agglom_mpi.config.relations import quantity_problems, read_constraints, read_derived
from agglom_mpi.config.scene import MAX_PARTICLES, SceneSection
from agglom_mpi.config.scene_paths import PathEntries, read_paths
from agglom_mpi.config.searchable import check_given_strings
from agglom_mpi.config.yaml_source import CampaignError, Problem, Source, parse
from agglom_mpi.declaration.choices import Choice
from agglom_mpi.declaration.components import Whole
from agglom_mpi.declaration.declared import (
    NONE,
    Declared,
    FieldError,
    FieldPath,
    Fits,
    Line,
    Meaning,
    Problems,
    Reads,
    raise_field_errors,
)
from agglom_mpi.declaration.reading import PLAIN, Reading, problems_at
from agglom_mpi.measurements.files.size_columns import CurveKeys
from agglom_mpi.outcome import SPIN_UNITS, quantity_columns
from agglom_mpi.physics.sizes import CurveSizes, law_of_file
from agglom_mpi.search.methods.method import SearchMethod
from agglom_mpi.search.methods.surrogate import Surrogate
from agglom_mpi.search.objectives.growth import MaximumGrowth
from agglom_mpi.search.objectives.objective import Objective
from agglom_mpi.search.stopping import StoppingRule
from agglom_mpi.variables import VariableTable

# A section is checked against those before it; one that failed is not among them.


def _variables_fit_scene(entries: Any, reading: Reading) -> Problems:
    table = reading.variables
    return check_required(reading.earlier["scene"], ranges_of(entries, table), table)


def _derived_quantities(entries: Any, reading: Reading) -> Any:
    if "scene" not in reading.earlier:
        return ()
    scene = reading.earlier["scene"]
    if scene.has_spins and isinstance(entries, dict):
        taken = {column for name in SPIN_UNITS for column in quantity_columns(name)}
        message = "is the name of a column of samples of grains that spin; choose another"
        raise_field_errors([((name,), message) for name in entries if name in taken])
    return read_derived(entries, tuple(required_variables(scene, reading.variables)), reading)


def _comparisons(entries: Any, reading: Reading) -> Any:
    earlier = reading.earlier
    if "scene" not in earlier or "derived" not in earlier:
        return ()
    used = tuple(required_variables(earlier["scene"], reading.variables))
    return read_constraints(entries, used, earlier["derived"], reading)


def _data_fit_scene(data: tuple[DatumEntry, ...], reading: Reading) -> Problems:
    scene: SceneSection = reading.earlier["scene"]
    end = fixed_end(scene.end_time, reading.variables)
    varies = reading.variables.has_numbers_of("restitution")
    always_bonds = None if varies else scene.restitution.always_bonds
    return impossible_data(data, end, not scene.heating.is_absent, always_bonds)


def _census_fits(output: Output, reading: Reading) -> Problems:
    """Yield times of censuses that samples do not reach, and all where nothing is measured."""
    if output.census and not reading.earlier["data"]:
        yield ("census",), "is given, but nothing is measured; needs a section data"
        return
    end = fixed_end(reading.earlier["scene"].end_time, reading.variables)
    for i, time in enumerate(output.census):
        if message := late(time, end):
            yield ("census", i), message


def _objective_fits(objective: Objective, reading: Reading) -> Problems:
    """Yield names of quantities that are others' columns, and data that are not used."""
    earlier = reading.earlier
    names = list(objective.quantity_units)
    spins = SPIN_UNITS if "scene" in earlier and earlier["scene"].has_spins else ()
    for below, message in quantity_problems(names, earlier.get("derived", ()), spins):
        yield ("quantities", *below), message
    data = earlier.get("data")
    if data is not None and objective.needs_data and not data:
        message = f"is {objective.name!r}, which needs a section data"
        yield (objective.named_by,), message
    if data and not objective.needs_data:
        fitting = [name for name, each in Objective.components().items() if each.needs_data]
        message = f"is {objective.name!r}, which compares nothing with the section data"
        yield (objective.named_by,), f"{message}; {', '.join(fitting)} does"


def _volumes_fit(final: FinalAnswer | None, reading: Reading) -> Problems:
    particles, largest = reading.earlier["scene"].particles, final.volumes[-1] if final else 1
    if largest > 1 and largest * particles > MAX_PARTICLES:
        message = f"has {largest}; {particles:,} grains in a box allow at most"
        yield ("volumes",), f"{message} {MAX_PARTICLES // particles}"


def _search_fits(search: SearchMethod, reading: Reading) -> Problems:
    """Yield given strings outside the box, and a set without a target."""
    earlier = reading.earlier
    if "variables" in earlier and "scene" in earlier and search.listed:
        yield from check_given_strings(search.listed, _box(reading))
    objective = earlier.get("objective")
    if search.looks_for_a_set and objective is not None and not objective.is_magnitude:
        message = f"is 'set', which needs objective growth_target; it is {objective.name}"
        yield ("aim",), message


def _box(reading: Reading) -> VariableTable:
    box, scene = reading.earlier["variables"], reading.earlier["scene"]
    return box if isinstance(box, VariableTable) else variables_of(box, scene, reading.variables)


def _ensemble_fits(ensemble: StoppingRule, reading: Reading) -> Problems:
    """Yield a rule that the objective does not have, and races of a search without parents."""
    objective, search = reading.earlier.get("objective"), reading.earlier.get("search")
    if objective is not None and ensemble.name not in (rules := objective.rules or [ensemble.name]):
        message = f"is {ensemble.name!r}; with objective {objective.name} it must be"
        yield (ensemble.named_by,), f"{message} {' or '.join(rules)}"
    if search is not None and ensemble.racing is not None and not search.has_parents:
        message = f"is for the parents of a genetic search; {search.name} has none"
        yield ("racing",), message


def _criteria_fit(stopping: Stopping, reading: Reading) -> Problems:
    others = reading.earlier.get("search"), reading.earlier.get("objective")
    for key, criterion in stopping.criteria.items():
        for path, message in criterion.misfits(*others):
            yield (key, *path), message


def _certificate_fits(plan: CertificatePlan | None, reading: Reading) -> Problems:
    earlier = reading.earlier
    if plan is None:
        return
    if earlier["ensemble"].common_configurations:
        yield (), "needs ensemble.common_configurations: false, for their noise is not emulated"
    searched = [variable.name for variable in _box(reading).own]
    yield from plan.misfits(earlier["objective"], searched)


EXPERIMENTS: Final = "experiments"
"""Section of the experiments."""


class ExperimentEntry(Declared):
    """Keys of an experiment.

    Attributes
    ----------
    variables
        Values and ranges that are not shared, or replace shared ones.
    scene
        Keys of the scene that are not shared, or replace shared ones.
    data
        Its measurements; without any it is a candidate for the next experiment.
    correlations
        Correlations of the errors of these.
    """

    SUPPLIED: ClassVar[dict[str, str]] = dict.fromkeys(
        ("variables", "scene", "data", "correlations"), "none"
    )
    """Texts on defaults."""

    variables: dict[str, Any] = {}  # noqa: RUF012
    scene: dict[str, Any] = {}  # noqa: RUF012
    data: list[Any] = []  # noqa: RUF012
    correlations: list[Any] = []  # noqa: RUF012


class SceneDocument(Declared):
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
    experiments
        Experiments by name, each with `variables` and keys of `scene` of its own, and with its
        `data`, `{slow: {variables: {relative_speed: 0.5 m/s}, data: […]}}`.
    objective
        Number to minimise, such as the distance from a wanted growth.
    output
        Name of the campaign file; optional storage of particles and frames.
    final
        Re-estimate of the best strings on fresh samples; `none` omits it.
    """

    SUPPLIED: ClassVar[dict[str, str]] = {"experiments": "none"}
    """Texts on defaults."""

    title: Line = ""
    seed: Annotated[int, Whole(at_least=0, at_most=2**63 - 1)] = 0
    scene: Annotated[SceneSection, Meaning("the section on what is simulated")]
    variables: Annotated[
        Any,
        Meaning("the section of values and ranges"),
        Reads(read_entries, in_context=True),
        Fits(_variables_fit_scene, ("scene",)),
    ]
    derived: Annotated[Any, Reads(_derived_quantities, in_context=True)] = ()
    constraints: Annotated[Any, Reads(_comparisons, in_context=True)] = ()
    data: Annotated[
        tuple[DatumEntry, ...], Reads(read_data, in_context=True), Fits(_data_fit_scene, ("scene",))
    ] = ()
    correlations: tuple[Correlation, ...] = ()
    experiments: dict[str, ExperimentEntry] = {}  # noqa: RUF012  (a field, as of all documents)
    objective: Annotated[Objective, Choice(Objective), Fits(_objective_fits)] = MaximumGrowth()
    output: Annotated[Output, Fits(_census_fits, ("scene", "data"))] = Output()
    final: Annotated[FinalAnswer | None, NONE, Fits(_volumes_fit, ("scene",))] = FinalAnswer()

    @property
    def plan(self) -> Plan | None:
        """None: nothing is searched."""
        return None

    @property
    def for_campaign(self) -> dict[str, Any]:
        """Sections that a campaign has as they were read, by name."""
        names = "title", "seed", "objective", "plan", "output", "final"
        return {name: getattr(self, name) for name in names}

    @classmethod
    def prepared(
        cls, values: Mapping[Any, Any], reading: Reading
    ) -> tuple[Mapping[Any, Any], Problems]:
        """Return the sections that are not empty."""
        return {key: value for key, value in values.items() if value is not None}, ()


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
    certify
        Certificate of the feasible set by fresh runs after the search; `{}` has all defaults.
    """

    objective: Annotated[
        Objective,
        Choice(Objective),
        Fits(_objective_fits),
        Meaning(f"allowed: {', '.join(Objective.components())}"),
    ]
    search: Annotated[SearchMethod, Choice(SearchMethod), Fits(_search_fits)] = Surrogate()
    ensemble: Annotated[
        StoppingRule,
        Choice(StoppingRule),
        Fits(_ensemble_fits),
        Meaning("the number of samples per string, like {rule: fixed, samples: 10}"),
    ]
    stopping: Annotated[
        Stopping, Fits(_criteria_fit), Meaning("what ends the search, like {generations: 10}")
    ]
    certify: Annotated[
        CertificatePlan | None,
        NONE,
        Fits(_certificate_fits, ("objective", "variables", "scene", "ensemble")),
    ] = None

    @property
    def plan(self) -> Plan:
        """Sections `search`, `ensemble`, `stopping` and `certify`."""
        return Plan(self.search, self.ensemble, self.stopping, self.certify)


def read_document(
    source: Source, reading: Reading = PLAIN, kind: type[SceneDocument] | None = None
) -> tuple[SceneDocument, PathEntries]:
    """Validate a parsed campaign file; raise a CampaignError.

    Parameters
    ----------
    source
        The file.
    reading
        How it is read.
    kind
        Its sections; None: those of a campaign or of a scene alone, by what is in the file.

    Returns
    -------
    tuple
        The sections, and the numbers of the scene that stand under `variables`.
    """
    reason = "" if kind else _reason_for_search(source)
    if reason:
        source = with_method(source, reading)
    entries = read_paths(_with_sizes(source, reading), reading)
    reading = reading._replace(variables=entries.table)
    kind = kind or (CampaignDocument if reason else SceneDocument)
    try:
        document = kind.checked(entries.source.data, reading)
        stated = document.data, document.correlations, document.scene.end_time
        document = document.model_copy(update={"data": correlated(*stated, reading)})
    except FieldError as error:
        needs: dict[FieldPath, str] = {(section,): reason for section in NEEDED_TO_SEARCH}
        raise entries.error(entries.source.error(error, needs)) from None
    if entries.problems:
        raise CampaignError(*entries.problems)
    return document, entries


def parse_campaign(text: str, name: str) -> Source:
    """Parse the text of the campaign file `name`; raise a CampaignError if it is none."""
    source = parse(text, name)
    if not any(key in CampaignDocument.model_fields for key in source.data):
        # Perhaps a file with somebody's secrets: no key of it is quoted.
        message = "holds none of the sections of a campaign, such as `scene:` and `variables:`"
        raise CampaignError(Problem(name, None, "", message))
    return source


def _with_sizes(source: Source, reading: Reading) -> Source:
    """Return a file with what is in the file of sizes that its scene may name."""
    scene: Any = source.data.get("scene")
    sizes: Any = scene.get("sizes") if isinstance(scene, dict) else None
    law = law_of_file(sizes, reading)
    if law is None:
        return source
    given = {key: field for key, field in law.model_fields.items() if key not in law.not_in_files}
    rule = f"allowed beside file: {', '.join(key for key in given if key != 'file')}"
    unknown = [str(key) for key in sizes if key not in given]
    problems: list[tuple[FieldPath, str]] = [
        ((key,), f"unknown key '{key[:40]}'; {rule}") for key in unknown
    ]
    stated, wrong = dict[str, Any](), list[tuple[FieldPath, str]]()
    for key in (key for key in CurveKeys._fields if key in given and key in sizes):
        try:
            stated[key] = given[key].read(sizes[key], reading)
        except ValueError as error:
            wrong += problems_at(key, error)
    if not wrong:
        keys = CurveKeys(**stated) if issubclass(law, CurveSizes) else None
        try:
            sizes = {**sizes, **reading.files.diameters(sizes["file"], keys)}
        except FieldError as error:
            wrong += error.problems
        except ValueError as error:
            wrong.append((("file",), str(error)))
    if problems := problems + wrong:
        path = ("scene", "sizes")
        raise CampaignError(*(source.problem((*path, *key), message) for key, message in problems))
    return replace(source, data={**source.data, "scene": {**scene, "sizes": sizes}})


def with_method(source: Source, reading: Reading) -> Source:
    """Return a recorded file with the search method of its run: defaults differ by version."""
    search = source.data.get("search") or {}
    if not reading.search_method or not isinstance(search, dict) or "method" in search:
        return source
    return replace(
        source, data={**source.data, "search": {"method": reading.search_method, **search}}
    )


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
