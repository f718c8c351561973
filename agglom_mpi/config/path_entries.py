"""Numbers of the scene in the section `variables`: their paths, and a scene that has them all.

A scene is validated with the middle of each range in the place of the number, and what is wrong
with a number there is reported where the file has its range.
"""

from collections.abc import Mapping
from contextlib import suppress
from typing import Any, Final, NamedTuple

from pydantic import ValidationError

from agglom_mpi.config.bounds import Range, read_range
from agglom_mpi.config.scene import SceneSection
from agglom_mpi.config.scene_paths import (
    ScenePath,
    find_path,
    given_at,
    law_of_entry,
    with_number,
    with_numbers,
)
from agglom_mpi.config.yaml_source import CampaignError, Problem, Source
from agglom_mpi.declaration.declared import FieldPath
from agglom_mpi.declaration.reading import Reading
from agglom_mpi.variables import TEN, VOLUME_FRACTION, VariableTable

SECTION: Final = "variables"
KNOWN: Final = frozenset({*TEN.names, VOLUME_FRACTION.name})
"""Keys of the section that are no paths."""


class PathEntries(NamedTuple):
    """The numbers of a scene that a file gives under `variables`.

    Attributes
    ----------
    source
        The file as if its scene gave these numbers itself, each in the middle of its range.
    paths
        The numbers, by the order of their names.
    table
        The variables of the campaign.
    problems
        What is wrong with their keys.
    unread
        Paths whose ranges cannot be read, which the section's own model reports.
    """

    source: Source
    paths: tuple[ScenePath, ...]
    table: VariableTable
    problems: tuple[Problem, ...]
    unread: tuple[ScenePath, ...]

    def error(self, found: CampaignError) -> CampaignError:
        """Return the error on a file, whose problems are reported where the file has them."""
        places = {f"scene.{path.name}": path for path in (*self.paths, *self.unread)}
        unread = {f"scene.{path.name}" for path in self.unread}
        problems = list(self.problems)
        for problem in found.problems:
            path = places.get(problem.field)
            if path is None:
                problems.append(problem)
            elif problem.field not in unread:
                line = self.source.line((SECTION, path.name))
                field = f"{SECTION}.{path.name}"
                problems.append(problem._replace(line=line, field=field))
        return CampaignError(*problems)


def read_paths(source: Source, reading: Reading) -> PathEntries:
    """Return the numbers of the scene that a file gives under `variables`."""
    variables, scene = source.data.get(SECTION), source.data.get("scene")
    keys = [key for key in variables if key not in KNOWN] if isinstance(variables, dict) else []
    if not keys or not isinstance(scene, dict):
        return PathEntries(source, (), TEN, (), ())
    assert isinstance(variables, dict)
    scene = SceneSection.with_default_hardness(scene, reading)
    found, problems, refused = _known_paths(source, keys, scene, reading)
    ranges: dict[ScenePath, Range] = {}
    for path in found:
        with suppress(ValueError):
            ranges[path] = read_range(variables[path.name], path.variable, reading.recorded)
    whole, lines = scene, dict(source.lines)
    for path, entry in ranges.items():
        whole = with_number(whole, path, _middle(entry), reading)
        for end in range(1, len(path.keys) + 1):
            place: FieldPath = ("scene", *path.keys[:end])
            lines.setdefault(place, source.line((SECTION, path.name)))
    kept = {key: entry for key, entry in variables.items() if key not in refused}
    data = {**source.data, "scene": whole, SECTION: kept}
    paths = tuple(sorted(ranges, key=lambda path: path.name))
    return PathEntries(
        Source(source.name, data, lines),
        paths,
        _table(variables, whole, found, ranges, reading),
        tuple(problems),
        tuple(path for path in found if path not in ranges),
    )


def _known_paths(
    source: Source, keys: list[str], scene: Mapping[str, Any], reading: Reading
) -> tuple[list[ScenePath], list[Problem], set[str]]:
    """Return the paths among keys, what is wrong with others, and the keys that are reported."""
    found, problems, refused = [], [], set()
    for key in keys:
        place = (SECTION, key)
        if not _has_law(key, scene, reading):  # which the scene's own errors say
            refused.add(key)
            continue
        try:
            path = find_path(key, scene, reading)
            found.append(path)
            if (where := given_at(scene, path)) is not None:
                at = source.line(("scene", *where))
                message = f"is also given by the scene, line {at}; a number stands in one place"
                problems.append(source.problem(place, message))
        except ValueError as error:
            if key.split(".")[0] in SceneSection.model_fields or "." in key:
                problems.append(source.problem(place, str(error)))
                refused.add(key)
    return found, problems, refused


def _has_law(key: str, scene: Mapping[str, Any], reading: Reading) -> bool:
    """Return whether the law that a path leads to is known."""
    field = key.split(".")[0]
    if field in SceneSection.model_fields:
        try:
            law_of_entry(scene, field, reading)
        except ValueError:
            return False
    return True


def _middle(entry: Range) -> float:
    """Return the middle of a range in the scale in which it is searched."""
    lower, upper = entry.lower, entry.upper
    if lower == upper:
        return lower
    geometric = entry.logarithmic
    middle = lower * (upper / lower) ** 0.5 if geometric else lower + 0.5 * (upper - lower)
    return min(max(middle, lower), upper)


def _table(
    variables: Mapping[str, Any],
    scene: Mapping[str, Any],
    paths: list[ScenePath],
    ranges: Mapping[ScenePath, Range],
    reading: Reading,
) -> VariableTable:
    """Return the variables of a campaign.

    A volume fraction is one of its own where it stands for different size ratios over the box, as
    numbers of the sizes are searched on which their third moment depends.
    """
    further = [path.variable for path in paths]
    if VOLUME_FRACTION.name in variables:
        with suppress(ValidationError):  # which is reported with all else
            section = SceneSection.model_validate(scene, context=reading)
            of_sizes = {p: entry for p, entry in ranges.items() if p.section == "sizes"}
            own = any(_changes_volume(section, p, entry) for p, entry in of_sizes.items())
            further += [VOLUME_FRACTION] if own else []
    return VariableTable(further)


def _changes_volume(section: SceneSection, path: ScenePath, entry: Range) -> bool:
    """Return whether the third moment of the sizes differs at the ends of a range."""
    for end in (entry.lower, entry.upper):
        try:
            cubes = with_numbers(section, {path: end}).third_moment
        except ValueError:  # a law refuses it, which is reported later
            return True
        if abs(cubes - section.third_moment) > 1e-12 * cubes:
            return True
    return False
