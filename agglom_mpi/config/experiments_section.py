"""Section `experiments`: the parts of a campaign that each experiment has of its own.

Each experiment is read as a campaign file would be that gives its values in place of the shared
ones. A range that stands within an experiment is a variable of the campaign with its name, such as
`fast.relative_speed`; all others are shared.
"""

import re
from collections.abc import Iterator, Mapping, Sequence
from typing import Annotated, Any, Final, NamedTuple

from agglom_mpi.config.bounds import variables_of
from agglom_mpi.config.data_section import DatumEntry
from agglom_mpi.config.document import (
    EXPERIMENTS,
    NEEDED_TO_SEARCH,
    CampaignDocument,
    ExperimentEntry,
    SceneDocument,
    read_document,
    with_method,
)
from agglom_mpi.config.own_components import own_of
from agglom_mpi.config.plan import FinalAnswer, Output
from agglom_mpi.config.scene import SceneSection
from agglom_mpi.config.yaml_source import CampaignError, Problem, Source
from agglom_mpi.declaration.declared import NONE, FieldError, FieldPath, Fits, Problems
from agglom_mpi.declaration.given_values import FRACTIONS, SIZES
from agglom_mpi.declaration.reading import Reading
from agglom_mpi.declaration.units import quoted
from agglom_mpi.measurements.layout import prefix_of
from agglom_mpi.variables import (
    MAX_VARIABLE_NAME,
    PAPER_VARIABLES,
    VOLUME_FRACTION,
    Variable,
    VariableTable,
)

MAX_EXPERIMENTS: Final = 20
"""Maximum number of experiments of a campaign."""
_NAME: Final = re.compile(r"[a-z][a-z0-9_]{0,19}")
_MERGED: Final = {"scene": SIZES, "variables": FRACTIONS}
"""Sections that an experiment changes keys of, with keys of which one stands for another."""
_OF_ONE: Final = ("data", "correlations")
"""Sections that belong to an experiment each."""
_WITHOUT: Final = ("derived", "constraints")
"""Sections that a campaign with experiments has none of."""


class ReadExperiment(NamedTuple):
    """The sections of an experiment, and its variables.

    Attributes
    ----------
    document
        Its sections.
    table
        Its variables with their ranges.
    given
        Names of the variables that it gives itself.
    """

    document: SceneDocument
    table: VariableTable
    given: frozenset[str]


def read_experiments(source: Source, reading: Reading) -> dict[str, ReadExperiment]:
    """Return the experiments of a campaign file by name; raise a CampaignError."""
    problems = [source.problem(path, message) for path, message in _section_problems(source)]
    if problems:
        raise CampaignError(*problems)
    entries: Mapping[str, Any] = source.data[EXPERIMENTS]
    found: dict[str, ReadExperiment] = {}
    errors: dict[str, Sequence[Problem]] = {}
    for name, entry in entries.items():
        try:
            found[name] = _read(source, name, entry or {}, reading)
        except CampaignError as error:
            errors[name] = error.problems
    if errors:
        raise CampaignError(*placed(source, errors))
    problems = [source.problem(path, message) for path, message in _joint_problems(source, found)]
    if problems:
        raise CampaignError(*problems)
    return found


def _section_problems(source: Source) -> Iterator[tuple[FieldPath, str]]:
    """Yield what is wrong with the names and keys of experiments, and what may not be beside."""
    entries = source.data[EXPERIMENTS]
    if not isinstance(entries, dict) or not entries:
        message = f"is {quoted(entries)}; must be a mapping like {{slow: {{data: […]}}, fast: …}}"
        yield (EXPERIMENTS,), message
        return
    if len(entries) > MAX_EXPERIMENTS:
        yield (EXPERIMENTS,), f"has {len(entries)} entries; must be at most {MAX_EXPERIMENTS}"
    for key in (*_OF_ONE, *_WITHOUT):
        if source.data.get(key) is not None:
            where = f"each belongs to one: {EXPERIMENTS}.{next(iter(entries))}.{key}"
            why = where if key in _OF_ONE else "it must be left out"
            yield (key,), f"stands beside {EXPERIMENTS}; {why}"
    taken = {*(v.name for v in PAPER_VARIABLES), VOLUME_FRACTION.name, *SceneDocument.model_fields}
    taken |= {*SceneSection.model_fields}
    for name, entry in entries.items():
        path = EXPERIMENTS, name
        if not _NAME.fullmatch(name):
            rule = "must be small letters, digits and _, a letter first, at most 20 characters"
            yield path, f"is no name for an experiment; {rule}"
        elif name in taken:
            yield path, "is the name of a variable, or of a key of the file; choose another"
        if entry is not None and not isinstance(entry, dict):
            yield path, f"is {quoted(entry)}; must be a mapping like {{variables: …, data: […]}}"
            continue
        try:
            ExperimentEntry.checked({k: v for k, v in (entry or {}).items() if v is not None})
        except FieldError as error:
            yield from (((*path, *below), message) for below, message in error.problems)
    if not any(isinstance(entry, dict) and entry.get("data") for entry in entries.values()):
        yield (EXPERIMENTS,), "has no data; at least one experiment must have some"


def _read(source: Source, name: str, entry: Mapping[str, Any], reading: Reading) -> ReadExperiment:
    """Return an experiment, read as a file that gives its values in place of the shared ones."""
    own = reading._replace(files=reading.files.of_experiment(name))
    document, paths = read_document(_merged(source, name, entry), own, SceneDocument)
    table = variables_of(document.variables, document.scene, paths.table)
    given = set(entry.get("variables") or ())
    given |= set(FRACTIONS) if given.intersection(FRACTIONS) else set()
    return ReadExperiment(document, table, frozenset(given))


def _merged(source: Source, name: str, entry: Mapping[str, Any]) -> Source:
    """Return the file of an experiment alone, with the lines of its entries."""
    at: FieldPath = (EXPERIMENTS, name)
    data: dict[str, Any] = {key: entry[key] for key in _OF_ONE if entry.get(key) is not None}
    lines: dict[FieldPath, int] = {(): source.lines[()]}
    for section, alike in _MERGED.items():
        shared, own = source.data.get(section), entry.get(section) or {}
        data[section] = shared
        if isinstance(shared, dict) or (shared is None and own):
            replaced = {*own, *(alike if {*own}.intersection(alike) else ())}
            kept = {key: value for key, value in (shared or {}).items() if key not in replaced}
            data[section] = kept | own
        lines |= {p: line for p, line in source.lines.items() if p and p[0] == section}
    for path, line in source.lines.items():
        if path[:2] == at and len(path) > 2 and (path[2] in data) and path[2:] != (path[2],):
            lines[path[2:]] = line
    for key in _OF_ONE:
        if (*at, key) in source.lines:
            lines[(key,)] = source.lines[*at, key]
    return Source(source.name, data, lines)


def placed(source: Source, problems: Mapping[str, Sequence[Problem]]) -> list[Problem]:
    """Return the problems of experiments, by name, each once, where the file has what is wrong."""
    lines = {".".join(map(str, path)): line for path, line in source.lines.items()}
    shared = {field for field in lines if field.partition(".")[0] in _MERGED}
    everywhere = set.intersection(*({(p.field, p.message) for p in e} for e in problems.values()))
    is_in_all = len(problems) == len(source.data[EXPERIMENTS])
    found: dict[Problem, None] = {}
    for name, some in problems.items():
        entry, start = source.data[EXPERIMENTS][name] or {}, f"{EXPERIMENTS}.{name}"
        own = [f"{section}.{key}" for section in _MERGED for key in entry.get(section) or ()]
        for problem in some:
            field = problem.field
            is_own = any(f"{field}.".startswith(f"{each}.") for each in (*own, *_OF_ONE))
            is_missing = field not in shared
            if is_own or (
                is_missing and not (is_in_all and (field, problem.message) in everywhere)
            ):
                field = f"{start}.{field}"
                problem = problem._replace(field=field, line=_line(lines, field))
            found[problem] = None
    return list(found)


def _line(lines: Mapping[str, int], field: str) -> int:
    """Return the line of a field, or of the nearest mapping around it."""
    while field not in lines:
        field = field.rpartition(".")[0]
    return lines[field]


def _joint_problems(
    source: Source, read: Mapping[str, ReadExperiment]
) -> Iterator[tuple[FieldPath, str]]:
    """Yield what does not fit together: ranges that differ or are unused, code of one's own."""
    shared = source.data.get("variables")
    for key, value in (shared or {}).items():
        if isinstance(value, list) and all(key in each.given for each in read.values()):
            yield ("variables", key), "is a range that every experiment replaces; leave it out"
    first, ranges = next(iter(read.values())), dict[str, Variable]()
    known = {repr(each.own) for each in own_of(first.document)}
    for name, each in read.items():
        path: FieldPath = (EXPERIMENTS, name)
        if not {repr(own.own) for own in own_of(each.document)} <= known:
            message = "names code of one's own; all experiments must share such a component"
            yield (*path, "scene"), message
        for variable in each.table.variables:
            if not variable.is_searched:
                continue
            if variable.name in each.given:
                yield from _own_range_problems(path, variable, each)
                continue
            before = ranges.setdefault(variable.name, variable)
            if before[5:8] != variable[5:8]:
                fraction = VOLUME_FRACTION.name
                named = fraction if fraction in (shared or {}) else variable.name
                message = f"is another range in {name}, whose law of sizes differs"
                yield ("variables", named), f"{message}; give each experiment its own"
        if any(v.name == VOLUME_FRACTION.name for v in each.table.variables) != any(
            v.name == VOLUME_FRACTION.name for v in first.table.variables
        ):
            message = "is a variable of its own here, as the law of sizes is searched"
            yield path, f"{VOLUME_FRACTION.name} {message}; all experiments must agree in that"


def _own_range_problems(
    path: FieldPath, variable: Variable, read: ReadExperiment
) -> Iterator[tuple[FieldPath, str]]:
    where = (*path, "variables", variable.name)
    if variable.name == "size_ratio" and read.table.by_volume_fraction:
        place = (*path, "variables", VOLUME_FRACTION.name)
        yield place, "is a range within an experiment; give a range of size_ratio in its place"
    name = f"{prefix_of(str(path[1]))}{variable.name}"
    if len(name.encode()) > MAX_VARIABLE_NAME:
        message = f"is the variable {name}, {len(name)} characters long; must be at most"
        yield where, f"{message} {MAX_VARIABLE_NAME}"


def _stores_no_particles(output: Output, reading: Reading) -> Problems:
    for key in ("final_particles", "frames"):
        if getattr(output, key):
            yield (key,), "must be left out beside experiments; simulate one of them for particles"


def _has_one_volume(final: FinalAnswer | None, reading: Reading) -> Problems:
    if final is not None and final.larger:
        yield ("volumes",), "must be left out beside experiments, which have a scene each"


class ExperimentsDocument(CampaignDocument):
    """The sections that all experiments share; scene, variables and data are read already."""

    variables: Any = None
    data: tuple[DatumEntry, ...] = ()
    output: Annotated[Output, Fits(_stores_no_particles)] = Output()
    final: Annotated[FinalAnswer | None, NONE, Fits(_has_one_volume)] = FinalAnswer()


def read_joint_document(
    source: Source,
    scene: SceneSection,
    variables: VariableTable,
    data: tuple[DatumEntry, ...],
    reading: Reading,
) -> ExperimentsDocument:
    """Validate the sections that all experiments of a campaign share; raise a CampaignError.

    Parameters
    ----------
    source
        The file.
    scene
        Section of the first experiment.
    variables, data
        Those of all experiments.
    reading
        How the file is read.
    """
    shared = with_method(source, reading).data
    given = {key: value for key, value in shared.items() if key != EXPERIMENTS}
    given |= {"scene": scene, "variables": variables, "data": data}
    try:
        return ExperimentsDocument.checked(given, reading._replace(variables=variables))
    except FieldError as error:
        reason = (
            f"the section {EXPERIMENTS}, line {source.line((EXPERIMENTS,))}, makes this a search"
        )
        needs: dict[FieldPath, str] = {(section,): reason for section in NEEDED_TO_SEARCH}
        raise source.error(error, needs) from None
