"""Section `experiments`: the parts of a campaign that each experiment has of its own.

Each experiment is read as a campaign file would be that gives its values in place of the shared
ones. A range that stands within an experiment is a variable of the campaign with its name, such as
`fast.relative_speed`; all others are shared.
"""

import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, Final, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from agglom_mpi.config.bounds import variables_of
from agglom_mpi.config.document import EXPERIMENTS, ExperimentEntry, SceneDocument, read_document
from agglom_mpi.config.own_components import own_of
from agglom_mpi.config.scene import SceneSection
from agglom_mpi.config.yaml_source import CampaignError, Problem, Source
from agglom_mpi.declaration.declared import FieldError, FieldPath
from agglom_mpi.declaration.given_values import FRACTIONS, SIZES
from agglom_mpi.declaration.reading import Reading
from agglom_mpi.declaration.units import quoted
from agglom_mpi.measurements.layout import prefix_of
from agglom_mpi.random_streams import experiment_seed
from agglom_mpi.variables import (
    MAX_VARIABLE_NAME,
    PAPER_VARIABLES,
    VOLUME_FRACTION,
    Variable,
    VariableTable,
)

if TYPE_CHECKING:
    from agglom_mpi.config.campaign import Campaign

Floats = NDArray[np.float64]

MAX_EXPERIMENTS: Final = 20
"""Maximum number of experiments of a campaign."""
_NAME: Final = re.compile(r"[a-z][a-z0-9_]{0,19}")
_MERGED: Final = {"scene": SIZES, "variables": FRACTIONS}
"""Sections that an experiment changes keys of, with keys of which one stands for another."""
_OF_ONE: Final = ("data", "correlations")
"""Sections that belong to an experiment each."""
_WITHOUT: Final = ("derived", "constraints")
"""Sections that a campaign with experiments has none of."""


@dataclass(frozen=True, eq=False)
class CampaignExperiment:
    """An experiment of a campaign.

    Attributes
    ----------
    name
        Its name.
    campaign
        The experiment as a campaign of its own, with its scene, variables and data.
    places
        Place in a string of the whole campaign of each of its own k variables, -1 where it has a
        value of its own, shape (k,).
    """

    name: str
    campaign: "Campaign"
    places: NDArray[np.int64]

    def own(self, strings: ArrayLike) -> Floats:
        """Return the experiment's strings, (…, k), of strings of the whole campaign."""
        taken = np.asarray(strings, np.float64)[..., self.places]
        return np.where(self.places >= 0, taken, self.campaign.variables.lower)


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
    known = set(map(repr, _own_components(first.document)))
    for name, each in read.items():
        path: FieldPath = (EXPERIMENTS, name)
        for component in _own_components(each.document):
            if repr(component) not in known:
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
    """Yield what is wrong with a range within an experiment."""
    where = (*path, "variables", variable.name)
    if variable.name == "size_ratio" and read.table.by_volume_fraction:
        place = (*path, "variables", VOLUME_FRACTION.name)
        yield place, "is a range within an experiment; give a range of size_ratio in its place"
    name = f"{prefix_of(str(path[1]))}{variable.name}"
    if len(name.encode()) > MAX_VARIABLE_NAME:
        message = f"is the variable {name}, {len(name)} characters long; must be at most"
        yield where, f"{message} {MAX_VARIABLE_NAME}"


def _own_components(document: SceneDocument) -> list[Any]:
    """Return the components of one's own of a scene."""
    return [each.own for each in own_of(document)]  # type: ignore[arg-type]


def joint_table(read: Mapping[str, ReadExperiment]) -> VariableTable:
    """Return the variables of a campaign by those of its experiments."""
    shared, own, differing = dict[str, Variable](), list[Variable](), set[str]()
    tables = {name: each.table for name, each in read.items()}
    for name, table in tables.items():
        for variable in table.variables:
            if variable.is_used and variable.name not in read[name].given:
                before = shared.setdefault(variable.name, variable)
                if before[5:8] != variable[5:8]:  # a size ratio of other laws of sizes
                    differing.add(variable.name)
            elif variable.is_searched:
                own.append(_named(variable, name))
    for name in differing:
        del shared[name]
    of_sizes = next((t for t in tables.values() if "size_ratio" in t.used), None)
    further = [v for v in shared.values() if v.name not in {p.name for p in PAPER_VARIABLES}]
    ignored = {name for table in tables.values() for name in table.ignored} - shared.keys()
    return VariableTable([*further, *own]).with_ranges(
        shared | {variable.name: variable for variable in own},
        ignored=tuple(v.name for v in PAPER_VARIABLES if v.name in ignored),
        by_volume_fraction="size_ratio" in shared
        and of_sizes is not None
        and of_sizes.by_volume_fraction,
        third_moment=1.0 if of_sizes is None else of_sizes.third_moment,
    )


def _named(variable: Variable, experiment: str) -> Variable:
    """Return a variable of an experiment as one of the campaign."""
    name = f"{prefix_of(experiment)}{variable.name}"
    meaning = f"{variable.meaning}, in the experiment {experiment}"
    return variable._replace(name=name, symbol=name, meaning=meaning)


def experiment_of(
    name: str, campaign: "Campaign", given: frozenset[str], whole: VariableTable
) -> CampaignExperiment:
    """Return an experiment of a campaign whose variables are `whole`.

    Parameters
    ----------
    name
    campaign
        The experiment as a campaign of its own.
    given
        Names of the variables that it gives itself.
    whole
    """
    places = []
    for variable in campaign.variables.variables:
        taken = f"{prefix_of(name)}{variable.name}" if variable.name in given else variable.name
        is_there = variable.is_used and taken in whole and whole[taken].is_used
        places.append(whole.index(taken) if is_there else -1)
    return CampaignExperiment(name, campaign, np.array(places, np.int64))


def in_seed(experiment: CampaignExperiment, seed: int) -> CampaignExperiment:
    """Return an experiment of the campaign with another seed."""
    own = replace(experiment.campaign, seed=experiment_seed(seed, experiment.name))
    return replace(experiment, campaign=own)
