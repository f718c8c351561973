"""Numbers of a scene as variables: their paths, such as `restitution.value`, and scenes with them.

A number stands in one place: in the scene, or under its path in the section `variables`. A scene is
validated with the middle of each range in the place of the number.
"""

from collections.abc import Iterator, Mapping
from contextlib import suppress
from typing import Any, Final, NamedTuple, get_args, get_origin

from agglom_mpi.config.bounds import read_range
from agglom_mpi.config.scene import SceneSection
from agglom_mpi.config.yaml_source import CampaignError, Problem, Source
from agglom_mpi.declaration.choices import Choice, choice_of
from agglom_mpi.declaration.components import (
    Component,
    In,
    UnknownComponentError,
    components_within,
    number_of,
)
from agglom_mpi.declaration.declared import DeclaredField, FieldPath
from agglom_mpi.declaration.reading import PLAIN, Reading
from agglom_mpi.declaration.spelling import suggestion
from agglom_mpi.variables import (
    MAX_VARIABLE_NAME,
    TEN,
    VOLUME_FRACTION,
    Variable,
    VariableTable,
    place_of,
)

NUMERICAL: Final = ("solver", "engine")
"""Sections of a scene whose numbers say how exactly it is computed, not what happens in it."""


def paths_of(scene: Mapping[str, Any], reading: Reading = PLAIN) -> dict[str, Variable]:
    """Return the numbers of a scene that can be searched, by path.

    Parameters
    ----------
    scene
        The section as it is in a file, not validated yet.
    reading
        Finds laws of one's own.
    """
    found = {}
    for key in SceneSection.model_fields:
        if key not in NUMERICAL:
            for path in _paths_in(scene, key, reading):
                found[path.name] = path
    return found


def _paths_in(scene: Mapping[str, Any], key: str, reading: Reading) -> Iterator[Variable]:
    if key in SceneSection.NUMBERS:
        yield _path((key,), SceneSection.NUMBERS[key], f"{key} of the scene")
        return
    law = None
    with suppress(UnknownComponentError, ValueError):  # the scene's own errors say so
        law = law_of_entry(scene, key, reading)
    if law is not None:
        yield from _paths_of_law(law, scene.get(key), (key,), reading)


def _paths_of_law(
    law: type[Component], entry: Any, keys: FieldPath, reading: Reading
) -> Iterator[Variable]:
    """Yield the numbers of a law whose entry stands at `keys`, and of laws within it."""
    for name, field in law.model_fields.items():
        number, choice = number_of(field), choice_of(field)
        if choice is not None and isinstance(entry, Mapping) and name in entry:
            with suppress(UnknownComponentError, ValueError):
                inner = choice.class_of(entry[name], reading)
                yield from _paths_of_law(inner, entry[name], (*keys, name), reading)
        if isinstance(number, In) and name not in law.not_in_files:
            named = f"{name} of {': '.join(['.'.join(map(str, keys)), *law.names()])}"
            places = _places(field)
            for place in range(places):
                yield _path((*keys, name, place), number, f"{named}, number {place}")
            if not places:
                yield _path((*keys, name), number, named)


def _path(keys: FieldPath, number: In, meaning: str) -> Variable:
    name = ".".join(map(str, keys))
    return Variable(name, number.unit, name, meaning, number.limits)


def _places(field: DeclaredField) -> int:
    """Return the number of places of a field that is a list of numbers; 0 of a single number."""
    is_list = get_origin(field.annotation) is tuple
    return len(get_args(field.annotation)) if is_list else 0


def law_of_entry(
    scene: Mapping[str, Any], key: str, reading: Reading = PLAIN
) -> type[Component] | None:
    """Return the class of the law in a field of a scene; None if there is no such field or law.

    Raises
    ------
    UnknownComponentError, ValueError
        If the scene names none that is known.
    """
    field = SceneSection.model_fields.get(key)
    if field is None:
        return None
    choice = choice_of(field)
    if choice is None:
        kind = field.annotation
        return kind if isinstance(kind, type) and issubclass(kind, Component) else None
    if key in scene:
        return choice.class_of(scene[key], reading)
    default = None if field.is_required() else field.default
    return None if default is None else type(default)


def find_path(name: str, scene: Mapping[str, Any], reading: Reading = PLAIN) -> Variable:
    """Return the number of a scene with a path; arguments as for `paths_of`.

    Raises
    ------
    ValueError
        If the scene has no such number, or it cannot be searched; with what is allowed.
    """
    known = paths_of(scene, reading)
    if name not in known:
        section = name.split(".")[0]
        same = [path.name for path in known.values() if path.section == section]
        allowed = f"allowed: {', '.join(same)}" if same else suggestion(name, list(known))
        raise ValueError(f"is no number of the scene that can be searched; {allowed}")
    if len(name.encode()) > MAX_VARIABLE_NAME:
        raise ValueError(
            f"has {len(name)} characters; a path must have at most {MAX_VARIABLE_NAME}"
        )
    return known[name]


def given_at(scene: Mapping[str, Any], path: Variable) -> FieldPath | None:
    """Return where a scene in a file gives a number itself; None if it leaves the number out."""
    value: Any = scene
    for key in path.place:
        inside = key < len(value) if isinstance(key, int) and isinstance(value, list) else False
        if not inside and not (isinstance(value, dict) and key in value):
            return None
        value = value[key]
    return None if value is None else path.place


def with_number(
    scene: Mapping[str, Any], path: Variable, value: float, reading: Reading = PLAIN
) -> dict[str, Any]:
    """Return a scene as it would be in a file if it gave the number itself."""
    key, *rest = path.place
    if not rest:
        return {**scene, str(key): value}
    law = law_of_entry(scene, str(key), reading)
    choice = choice_of(SceneSection.model_fields[str(key)])
    assert law is not None
    entry = scene.get(str(key))
    return {**scene, str(key): _entry_with_number(law, choice, entry, tuple(rest), value, reading)}


def _entry_with_number(
    law: type[Component],
    choice: Choice | None,
    entry: Any,
    keys: FieldPath,
    value: float,
    reading: Reading,
) -> dict[str, Any]:
    """Return the entry of a law as it would be if it gave the number at `keys` itself."""
    name = {choice.kind.named_by: next(iter(law.names()))} if choice and law.names() else {}
    entry = name if entry is None else entry
    if choice is not None:
        entry = choice.kind.as_mapping(entry)
    entry = {**name, **entry} if isinstance(entry, Mapping) else dict(name)
    field, *below = keys
    inner = choice_of(law.model_fields[str(field)])
    if inner is not None:
        within = inner.class_of(entry[field], reading)
        found = _entry_with_number(within, inner, entry[field], tuple(below), value, reading)
        return {**entry, field: found}
    if not below:
        return {**entry, field: value}
    listed = entry.get(field, law.model_fields[str(field)].default)
    if isinstance(listed, list | tuple) and int(below[0]) < len(listed):
        listed = [value if i == below[0] else each for i, each in enumerate(listed)]
    return {**entry, field: listed}


def with_numbers(section: SceneSection, numbers: Mapping[str, float]) -> SceneSection:
    """Return a scene with other values of numbers by their paths, which are within their limits.

    Raises
    ------
    ValueError
        If a law refuses them together.
    """
    changes: dict[str, Any] = {}
    changed: dict[str, Component] = {}
    for path, value in numbers.items():
        key, *rest = place_of(path)
        if rest:
            law = changed.get(str(key), getattr(section, str(key)))
            changed[str(key)] = _law_with_number(law, tuple(rest), value)
        else:
            changes[str(key)] = value
    for key, law in changed.items():
        for place, each in components_within(law, key):
            for where, message in each.problems():
                raise ValueError(f"{'.'.join(map(str, (*place, *where)))} {message}")
    return section.model_copy(update={**changes, **changed})


def _law_with_number(law: Component, keys: FieldPath, value: float) -> Component:
    """Return a law with another value of its number at `keys`, which is not checked."""
    field, below = str(keys[0]), keys[1:]
    known: Any = getattr(law, field)
    new: Any = value
    if isinstance(known, Component):
        new = _law_with_number(known, below, value)
    elif below:
        new = tuple(value if i == below[0] else each for i, each in enumerate(known))
    return law.model_copy(update={field: new})


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
    if not isinstance(variables, dict) or not isinstance(scene, dict):
        return PathEntries(source, TEN, ())
    keys = [key for key in variables if key not in KNOWN]
    if keys:
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
    table = VariableTable(found)
    with suppress(ValueError):  # which is reported with all else
        whole = SceneSection.checked(whole, reading)
        if VOLUME_FRACTION.name in variables and _changes_volume(whole, ranges):
            table = VariableTable([*found, VOLUME_FRACTION])
        table = table.with_ranges({}, third_moment=whole.third_moment)
    kept = {key: entry for key, entry in variables.items() if key not in refused}
    data = {**source.data, "scene": whole, SECTION: kept}
    return PathEntries(Source(source.name, data, lines), table, tuple(problems))


def _known_paths(
    source: Source, keys: list[str], scene: Mapping[str, Any], reading: Reading
) -> tuple[list[Variable], list[Problem], set[str]]:
    """Return the paths among keys, what is wrong with others, and the keys that are reported."""
    found, problems, refused = [], [], set()
    for key in keys:
        place = SECTION, key
        try:
            law_of_entry(scene, key.split(".")[0], reading)
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
            # Others are meant for a variable of the papers.
            if "." in key or key in SceneSection.model_fields:
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
            if entry.section == "sizes":
                for end in (entry.lower, entry.upper):
                    cubes = with_numbers(section, {name: end}).third_moment
                    if abs(cubes - section.third_moment) > 1e-12 * cubes:
                        return True
    except ValueError:  # a law refuses the end, which is reported later
        return True
    return False
