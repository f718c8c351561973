"""Paths of the real numbers of a scene, such as `restitution.value`, which a campaign may search.

A number stands in one place: in the scene, or under its path in the section `variables`.
"""

from collections.abc import Iterator, Mapping
from contextlib import suppress
from typing import Any, Final, NamedTuple, get_args, get_origin

from agglom_mpi.config.scene import SceneSection
from agglom_mpi.declaration.choices import choice_of
from agglom_mpi.declaration.components import Component, In, UnknownComponentError, Whole, number_of
from agglom_mpi.declaration.declared import DeclaredField, FieldPath
from agglom_mpi.declaration.reading import PLAIN, Reading
from agglom_mpi.declaration.spelling import suggestion
from agglom_mpi.variables import MAX_VARIABLE_NAME, Variable

NUMERICAL: Final = ("solver", "engine")
"""Sections of a scene whose numbers say how exactly it is computed, not what happens in it."""


class ScenePath(NamedTuple):
    """A real number of a scene.

    Attributes
    ----------
    keys
        Field of the scene, field of its law, and place where that is a list of numbers.
    variable
        The number as a variable, whose name is the path.
    """

    keys: FieldPath
    variable: Variable

    @property
    def section(self) -> str:
        """Field of the scene that the number is in."""
        return str(self.keys[0])

    @property
    def name(self) -> str:
        """The path as a campaign file names it."""
        return self.variable.name


def paths_of(scene: Mapping[str, Any], reading: Reading = PLAIN) -> dict[str, ScenePath]:
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


def _paths_in(scene: Mapping[str, Any], key: str, reading: Reading) -> Iterator[ScenePath]:
    """Yield the numbers of one field of a scene."""
    if key in SceneSection.NUMBERS:
        yield _path((key,), SceneSection.NUMBERS[key], f"{key} of the scene")
        return
    law = None
    with suppress(UnknownComponentError, ValueError):  # the scene's own errors say so
        law = law_of_entry(scene, key, reading)
    if law is None:
        return
    for name, field in law.model_fields.items():
        number = number_of(field)
        if isinstance(number, In) and name not in law.not_in_files:
            named = f"{name} of {': '.join([key, *law.names()])}"
            places = _places(field)
            for place in range(places):
                yield _path((key, name, place), number, f"{named}, number {place}")
            if not places:
                yield _path((key, name), number, named)


def _path(keys: FieldPath, number: In, meaning: str) -> ScenePath:
    name = ".".join(map(str, keys))
    return ScenePath(keys, Variable(name, number.unit, name, meaning, number.limits))


def _places(field: DeclaredField) -> int:
    """Return the number of places of a field that is a list of numbers; 0 of a single number."""
    is_list = get_origin(field.annotation) is tuple
    return len(get_args(field.annotation)) if is_list else 0


def law_of_entry(
    scene: Mapping[str, Any], key: str, reading: Reading = PLAIN
) -> type[Component] | None:
    """Return the class of the law in a field of a scene; None if the field holds none.

    Raises
    ------
    UnknownComponentError, ValueError
        If the scene names none that is known.
    """
    field = SceneSection.model_fields[key]
    choice = choice_of(field)
    if choice is None:
        kind = field.annotation
        return kind if isinstance(kind, type) and issubclass(kind, Component) else None
    if key in scene:
        return choice.class_of(scene[key], reading)
    default = None if field.is_required() else field.default
    return None if default is None else type(default)


def find_path(name: str, scene: Mapping[str, Any], reading: Reading = PLAIN) -> ScenePath:
    """Return the number of a scene with a path; arguments as for `paths_of`.

    Raises
    ------
    ValueError
        If the scene has no such number, or it cannot be searched; with what is allowed.
    """
    known = paths_of(scene, reading)
    if name not in known:
        raise ValueError(_why_not(name, scene, known, reading))
    if len(name.encode()) > MAX_VARIABLE_NAME:
        raise ValueError(
            f"has {len(name)} characters; a path must have at most {MAX_VARIABLE_NAME}"
        )
    return known[name]


def _why_not(
    name: str, scene: Mapping[str, Any], known: Mapping[str, ScenePath], reading: Reading
) -> str:
    """Return why a path names no number that can be searched."""
    key, *rest = name.split(".")
    if key not in SceneSection.model_fields:
        return f"is no number of the scene; {suggestion(name, list(known))}"
    if key in NUMERICAL:
        return "decides how exactly a sample is computed, not what happens; give it in the scene"
    numbers = [path for path in known if path.split(".")[0] == key]
    allowed = f"allowed: {', '.join(numbers)}" if numbers else "it has no number to search"
    law = law_of_entry(scene, key, reading)
    if law is None:
        whole = "is a whole number, which" if key == "particles" else "is no number, and"
        return f"{whole} cannot be searched; {suggestion(name, list(known))}"
    named = f"{key}: {next(iter(law.names()), '')}".rstrip(": ")
    field = law.model_fields.get(rest[0]) if rest else None
    if field is None:
        return f"is no number of {named}; {allowed}"
    if isinstance(number_of(field), Whole):
        return f"is a whole number, which cannot be searched; {allowed}"
    if isinstance(number_of(field), In):
        places = _places(field)
        wanted = f"is a list of {places} numbers; name one of them" if places else "is one number"
        return f"{wanted}; {allowed}"
    return f"is a choice or a text, which cannot be searched; {allowed}"


def given_at(scene: Mapping[str, Any], path: ScenePath) -> FieldPath | None:
    """Return where a scene in a file gives a number itself; None if it leaves the number out."""
    value: Any = scene
    for key in path.keys:
        inside = key < len(value) if isinstance(key, int) and isinstance(value, list) else False
        if not inside and not (isinstance(value, dict) and key in value):
            return None
        value = value[key]
    return None if value is None else path.keys


def with_number(
    scene: Mapping[str, Any], path: ScenePath, value: float, reading: Reading = PLAIN
) -> dict[str, Any]:
    """Return a scene as it would be in a file if it gave the number itself."""
    key, rest = path.section, path.keys[1:]
    if not rest:
        return {**scene, key: value}
    law = law_of_entry(scene, key, reading)
    choice = choice_of(SceneSection.model_fields[key])
    assert law is not None
    name = {choice.kind.named_by: next(iter(law.names()))} if choice and law.names() else {}
    entry = scene.get(key, name)
    if choice is not None:
        entry = choice.kind.as_mapping(entry)
    entry = {**name, **entry} if isinstance(entry, Mapping) else dict(name)
    if len(rest) == 1:
        return {**scene, key: {**entry, rest[0]: value}}
    field, place = rest
    listed = entry.get(field, law.model_fields[str(field)].default)
    if isinstance(listed, list | tuple) and int(place) < len(listed):
        listed = [value if i == place else each for i, each in enumerate(listed)]
    return {**scene, key: {**entry, field: listed}}


def with_numbers(section: SceneSection, numbers: Mapping[ScenePath, float]) -> SceneSection:
    """Return a scene with other values of some of its numbers, which are within their limits.

    Raises
    ------
    ValueError
        If a law refuses them together.
    """
    changes: dict[str, Any] = {}
    fields: dict[str, dict[str, Any]] = {}
    for path, value in numbers.items():
        key, *rest = path.keys
        if not rest:
            changes[str(key)] = value
            continue
        own = fields.setdefault(str(key), {})
        name = str(rest[0])
        if len(rest) == 1:
            own[name] = value
        else:
            known = own.get(name, getattr(getattr(section, str(key)), name))
            own[name] = tuple(value if i == rest[1] else each for i, each in enumerate(known))
    for key, own in fields.items():
        law = getattr(section, key).model_copy(update=own)
        for where, message in law.problems():
            raise ValueError(f"{'.'.join([key, *map(str, where)])} {message}")
        changes[key] = law
    return section.model_copy(update=changes)
