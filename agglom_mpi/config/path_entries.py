"""Numbers of the scene in the section `variables`: a file as if its scene had them all.

A scene is validated with the middle of each range in the place of the number.
"""

from collections.abc import Mapping
from contextlib import suppress
from typing import Any, Final, NamedTuple

from pydantic import ValidationError

from agglom_mpi.config.bounds import read_range
from agglom_mpi.config.scene import SceneSection
from agglom_mpi.config.scene_paths import (
    find_path,
    given_at,
    law_of_entry,
    with_number,
    with_numbers,
)
from agglom_mpi.config.yaml_source import CampaignError, Problem, Source
from agglom_mpi.declaration.reading import Reading
from agglom_mpi.variables import TEN, VOLUME_FRACTION, Variable, VariableTable

SECTION: Final = "variables"
KNOWN: Final = frozenset({*TEN.names, VOLUME_FRACTION.name})
"""Keys of the section that are no paths."""


class PathEntries(NamedTuple):
    """A file whose numbers of the scene stand under `variables`.

    Attributes
    ----------
    source
        The file as if its scene gave these numbers itself, each in the middle of its range.
    table
        The variables of the campaign.
    problems
        What is wrong with their keys.
    """

    source: Source
    table: VariableTable
    problems: tuple[Problem, ...]

    def error(self, found: CampaignError) -> CampaignError:
        """Return the error on a file: a number is reported once, where the file has it."""
        fields = {f"scene.{name}": f"{SECTION}.{name}" for name in self.table.of_scene}
        problems = [*self.problems, *(p for p in found.problems if p.field not in fields)]
        known = {problem.field for problem in problems}
        moved = (p._replace(field=fields[p.field]) for p in found.problems if p.field in fields)
        return CampaignError(*problems, *(p for p in moved if p.field not in known))


def read_paths(source: Source, reading: Reading) -> PathEntries:
    """Return the numbers of the scene that a file gives under `variables`."""
    variables, scene = source.data.get(SECTION), source.data.get("scene")
    keys = [key for key in variables if key not in KNOWN] if isinstance(variables, dict) else []
    if not keys or not isinstance(scene, dict):
        return PathEntries(source, TEN, ())
    assert isinstance(variables, dict)
    scene = SceneSection.with_default_hardness(scene, reading)
    found, problems, refused = _known_paths(source, keys, scene, reading)
    whole: Any = scene
    ranges, lines = dict[str, Variable](), dict(source.lines)
    for path in found:
        for end in range(1, len(path.place) + 1):
            lines.setdefault(("scene", *path.place[:end]), source.line((SECTION, path.name)))
        with suppress(ValueError):  # which the section's own model reports
            ranges[path.name] = read_range(variables[path.name], path, reading.recorded)
            whole = with_number(whole, path, _middle(ranges[path.name]), reading)
    further = list(found)
    with suppress(ValidationError):  # which is reported with all else
        whole = SceneSection.model_validate(whole, context=reading)
        if VOLUME_FRACTION.name in variables and _changes_volume(whole, ranges):
            further.append(VOLUME_FRACTION)
    kept = {key: entry for key, entry in variables.items() if key not in refused}
    data = {**source.data, "scene": whole, SECTION: kept}
    return PathEntries(Source(source.name, data, lines), VariableTable(further), tuple(problems))


def _known_paths(
    source: Source, keys: list[str], scene: Mapping[str, Any], reading: Reading
) -> tuple[list[Variable], list[Problem], set[str]]:
    """Return the paths among keys, what is wrong with others, and the keys that are reported."""
    found, problems, refused = [], [], set()
    for key in keys:
        place, law = (SECTION, key), key.split(".")[0]
        try:
            if law in SceneSection.model_fields:
                law_of_entry(scene, law, reading)
        except ValueError:  # which the scene's own errors say
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
            if law in SceneSection.model_fields or "." in key:
                problems.append(source.problem(place, str(error)))
                refused.add(key)
    return found, problems, refused


def _middle(entry: Variable) -> float:
    """Return the middle of a range in the scale in which it is searched."""
    lower, upper = entry.lower, entry.upper
    if lower == upper:
        return lower
    geometric = entry.logarithmic
    middle = lower * (upper / lower) ** 0.5 if geometric else lower + 0.5 * (upper - lower)
    return min(max(middle, lower), upper)


def _changes_volume(section: SceneSection, ranges: Mapping[str, Variable]) -> bool:
    """Return whether the third moment of the sizes differs over the box.

    A volume fraction, which then stands for different size ratios, is a variable of its own.
    """
    try:
        for name, entry in ranges.items():
            if name.startswith("sizes."):
                for end in (entry.lower, entry.upper):
                    cubes = with_numbers(section, {name: end}).third_moment
                    if abs(cubes - section.third_moment) > 1e-12 * cubes:
                        return True
    except ValueError:  # a law refuses the end, which is reported later
        return True
    return False
