"""Comparison of several campaign files."""

import json
import statistics
from collections.abc import Iterator, Mapping, Sequence
from typing import Any, Final, NamedTuple

from rich.console import Group, RenderableType

from agglom_mpi.analysis.best_strings import collect_best, variable_columns
from agglom_mpi.analysis.derived import recorded_box
from agglom_mpi.analysis.summary import collect_summary
from agglom_mpi.config.expressions import names_in
from agglom_mpi.config.relations import Relations
from agglom_mpi.config.yaml_source import CampaignError
from agglom_mpi.display.table import Column, Table
from agglom_mpi.errors import UserError
from agglom_mpi.formatting import format_duration, without_nan
from agglom_mpi.storage.reader import CampaignData
from agglom_mpi.storage.recorded_campaign import recorded_campaign

CONSTRAINTS: Final = "constraints"
SHOWN: Final = 12
"""Most differing settings that are listed; more are counted."""


class FileComparison(NamedTuple):
    """The results of several campaign files.

    Attributes
    ----------
    summaries : list of dict
        Of `collect_summary`, in the order of the files.
    differences : dict
        Settings that are not the same everywhere: name -> value in each file, None if it has none.
        Under `constraints` are lists of those that not all files have, as they are written.
    comparable : bool
        Whether all have the same objective and number of grains.
    units : dict
        SI units of the variables that are no pure numbers: `variables.density` -> `kg/m^3`.
    variables : tuple of Column
        The searched variables, in the units of the first file that searches each.
    """

    summaries: list[dict[str, Any]]
    differences: dict[str, list[Any]]
    comparable: bool
    units: dict[str, str]
    variables: tuple[Column, ...] = ()


def compare(files: Sequence[CampaignData]) -> FileComparison:
    """Compare campaign files, finished or not."""
    identities = [file.identity for file in files]
    names = dict.fromkeys(
        CONSTRAINTS if name.startswith(f"{CONSTRAINTS}.") else name
        for identity in identities
        for name in identity
    )
    differences: dict[str, list[Any]] = {}
    for name in names:
        values = [identity.get(name) for identity in identities]
        if name == CONSTRAINTS:
            values = _different_constraints(files)
        if any(value != values[0] for value in values):
            differences |= dict([_by_volume_fraction(name, values, files)])
    known = {each for file in files for each in file.variables.variables}
    units = {f"variables.{each.name}": each.unit for each in known if each.unit != "1"}
    summaries = [collect_summary(file, best=1) for file in files]
    variables = {each.key: each for file in reversed(files) for each in _searched(file)}
    columns = tuple(variables.values())
    return FileComparison(summaries, differences, is_one_question(files), units, columns)


def _searched(file: CampaignData) -> Iterator[Column]:
    """Yield the columns of the searched variables of a file, and of the volume fraction."""
    names = {each.name for each in recorded_box(file).variables if each.is_searched}
    names |= {"volume_fraction"} if "size_ratio" in names else set()
    yield from (each for each in variable_columns(file, collect_best(file, 1)) if each.key in names)


class PoolingError(UserError, ValueError):
    """Files whose samples cannot be pooled, with the reason."""


def pooled(files: Sequence[CampaignData]) -> CampaignData:
    """Return the first of files of one question, whose set and posterior rest on all of them.

    Raises
    ------
    PoolingError
        If two have the same seed, or differ in more than the seed, with what differs.
    """
    first, *others = files
    by_seed = dict[Any, CampaignData]()
    for file in files:
        keys = sorted((first.identity.keys() | file.identity.keys()) - {"seed"})
        different = [key for key in keys if first.identity.get(key) != file.identity.get(key)]
        if different:
            names = ", ".join(different[:SHOWN])
            raise PoolingError(f"{file.path}: is of another question than {first.path}: {names}")
        same = by_seed.setdefault(file.identity["seed"], file)
        if same is not file:
            raise PoolingError(f"{file.path}: has the seed of {same.path}, hence its samples")
    first.pooled = tuple(others)
    return first


def is_one_question(files: Sequence[CampaignData]) -> bool:
    """Return whether all files have the same objective and number of grains."""
    decisive = [
        {
            name: value
            for name, value in file.identity.items()
            if name == "scene.particles" or name.startswith("objective")
        }
        for file in files
    ]
    return all(each == decisive[0] for each in decisive)


def _different_constraints(files: Sequence[CampaignData]) -> list[Any]:
    """Return the constraints of each file that not all have, as written; None if there are none."""
    found = [_constraints_of(file) for file in files]
    everywhere = set(found[0]).intersection(*found)
    texts = [[each[key] for key in each if key not in everywhere] for each in found]
    return [some or None for some in texts]


def _constraints_of(file: CampaignData) -> dict[str, str]:
    """Return the constraints of a file as they are written, by what they are in SI units."""
    stored = [v for n, v in file.identity.items() if n.startswith(f"{CONSTRAINTS}.")]
    try:
        relations = recorded_campaign(file).relations
    except CampaignError:  # its text is damaged
        return {str(canonical): str(canonical) for canonical in stored}
    texts = [_written(relations, place) for place in range(len(relations.constraints))]
    return dict(zip(relations.canonical(), texts, strict=True))


def _written(relations: Relations, place: int) -> str:
    """Return a constraint as it is written, with the derived quantities that it names."""
    constraint = relations.constraints[place]
    trees = {each.name: each for each in relations.derived}
    named, wanted = dict[str, str](), [*names_in(*constraint.operands)]
    while wanted:
        name = wanted.pop(0)
        if name in trees and name not in named:
            named[name] = f"{name} = {trees[name].text}"
            wanted += names_in(trees[name].tree)
    return f"{constraint.text} ({', '.join(named.values())})" if named else constraint.text


def _by_volume_fraction(
    name: str, values: list[Any], files: Sequence[CampaignData]
) -> tuple[str, list[Any]]:
    """Return a setting with the volume fraction for the size ratio, where all files give it."""
    if not name.startswith("variables.size_ratio."):
        return name, values
    try:
        boxes = [recorded_campaign(file).variables for file in files]
    except CampaignError:
        return name, values
    if not all(box.by_volume_fraction for box in boxes):
        return name, values
    if all(isinstance(value, float) for value in values):
        pairs = zip(values, boxes, strict=True)  # rounded as the campaign writes it
        values = [float(f"{box.fraction(value):.12g}") for value, box in pairs]
    return name.replace("size_ratio", "volume_fraction"), values


def best_objectives(comparison: FileComparison) -> dict[str, list[float]]:
    """Return the objectives of the files' best strings, by the kind of samples.

    Those `as searched` are of all files that have a best string, those `re-estimated` of the files
    that estimated it again.
    """
    best = [entry for summary in comparison.summaries for entry in summary["best"]]
    again = [entry["reestimate"] for entry in best if entry["reestimate"]]
    return {
        "as searched": [entry["objective"] for entry in best],
        "re-estimated": [entry["objective"] for entry in again],
    }


COLUMNS: Final = (
    Column("file"),
    Column("state", text=True),
    Column("generations", format="d"),
    Column("strings", format="d"),
    Column("samples", format="d"),
    Column("seconds", "time", format=format_duration),
    Column("searched", "best as searched"),
    Column("again", "re-estimate"),
)


def comparison_table(comparison: FileComparison) -> RenderableType:
    """Return a table of the files, the spread of their best strings and differing settings."""
    rows = [_row(summary) for summary in comparison.summaries]
    table = Table((*COLUMNS, *comparison.variables), rows)
    return Group(table, "", *_footer(comparison))


def _row(summary: Mapping[str, Any]) -> dict[str, Any]:
    row = {**summary, "searched": "no result" if summary["no_result"] else None}
    row["samples"] = summary["samples_simulated"] + summary["samples_fresh"]
    for entry in () if summary["no_result"] else summary["best"]:
        row |= {key: value for key, value in entry.items() if key not in row}
        row["searched"] = entry["objective"], entry["standard_error"]
        if again := entry["reestimate"]:
            row["again"] = again["objective"], again["standard_error"]
    return row


def _footer(comparison: FileComparison) -> Iterator[str]:
    if not comparison.comparable:
        yield "objectives are not of the same question, and cannot be compared"
    else:
        for kind, values in best_objectives(comparison).items():
            if len(values) > 1:
                middle, low, high = statistics.median(values), min(values), max(values)
                yield (
                    f"best strings of {len(values)} files, {kind}: median {middle:.4f}, from "
                    f"{low:.4f} to {high:.4f}; ± is a standard error"
                )
    settings = comparison.differences
    for name, values in list(settings.items())[:SHOWN]:
        yield _setting(name, values, comparison.units)
    if len(settings) > SHOWN:
        yield f"and {len(settings) - SHOWN} more settings differ (--json has all)"
    if not settings:
        yield "all are of the same campaign, with the same seed"


def _setting(name: str, values: list[Any], units: Mapping[str, str]) -> str:
    """Return a setting with its value in each file, in a line; constraints with a line for each."""
    unit = units.get(name.rpartition(".")[0], "")
    texts = [_text(value) for value in values]
    if name == CONSTRAINTS:
        return "\n".join([f"{name}:", *(f"  file {i}: {text}" for i, text in enumerate(texts, 1))])
    return f"{name}: {', '.join(texts)}{f' {unit}' if unit else ''}"


def _text(value: Any) -> str:
    match value:
        case None:
            return "none"
        case list():
            return "; ".join(map(_text, value))
        case float():
            return repr(value).removesuffix(".0")
    return str(value)


def to_json(comparison: FileComparison, further: Mapping[str, Any] | None = None) -> str:
    """Return a comparison as JSON, with `further` entries."""
    more = {
        **(further or {}),
        "differences": comparison.differences,
        "comparable": comparison.comparable,
    }
    return json.dumps({"files": without_nan(comparison.summaries), **more}, indent=2)
