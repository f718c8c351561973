"""Every number of every component of a scene is searched by its path, or refused with a reason."""

from typing import get_args

import pytest
from hypothesis import given
from hypothesis import strategies as st

from agglom_mpi.config.scene import SceneSection
from agglom_mpi.config.scene_paths import (
    NUMERICAL,
    find_path,
    given_at,
    law_of_entry,
    paths_of,
    with_number,
)
from agglom_mpi.declaration.choices import choice_of
from agglom_mpi.declaration.components import Component, In, number_of

SCENE = {
    "particles": 50,
    "half_width": 0.01,
    "velocities": "spread",
    "restitution": "pressure",
    "hardness": "constant",
    "end_time": 1.0,
}


def laws() -> list[tuple[str, str]]:
    """Return each field of a scene that holds a law, with the name of each law."""
    found = []
    for key, field in SceneSection.model_fields.items():
        if choice := choice_of(field):
            found += [(key, name) for name in choice.kind.components()]
    return [*found, ("contact_area", "")]


def scene_with(key: str, name: str) -> dict[str, object]:
    entry = {"law": name} if name else {}
    fields = law_of_entry({key: entry}, key).model_fields
    inner = [each for each, field in fields.items() if choice_of(field)]
    return {**SCENE, key: {**entry, **dict.fromkeys(inner, "pressure")}}


def allowed_value(limits) -> float:
    """Return a number within limits."""
    return next(value for value in (0.5, 1.5, 2.5) if not limits.broken_by(value))


@pytest.mark.parametrize(("key", "name"), laws())
def test_every_field_of_every_law_is_a_path_or_refused(key, name):
    scene = scene_with(key, name)
    law = law_of_entry(scene, key)
    known = paths_of(scene)
    for field_name, field in law.model_fields.items():
        number, path = number_of(field), f"{key}.{field_name}"
        places = get_args(field.annotation) if "tuple" in str(field.annotation) else ()
        if isinstance(number, In) and key not in NUMERICAL:
            paths = [f"{path}.{i}" for i in range(len(places))] if places else [path]
            assert set(paths) <= known.keys()
            assert [find_path(each, scene).unit for each in paths] == ([number.unit] * len(paths))
        else:
            assert path not in known
            with pytest.raises(ValueError, match=r"\w"):
                find_path(path, scene)


@pytest.mark.parametrize(("key", "name"), laws())
def test_a_number_that_is_put_into_a_scene_is_the_one_that_its_law_has(key, name):
    scene = scene_with(key, name)
    for path in paths_of(scene).values():
        if path.place[0] != key:
            continue
        value = allowed_value(path.limits)
        entry = with_number(scene, path, value)[key]
        assert given_at({key: entry}, path) == path.place
        whole = {
            each: allowed_value(other.limits)
            for other in paths_of(scene).values()
            if other.place[0] == key and len(other.place) == 2
            for each in [other.place[1]]
            if law_of_entry(scene, key).model_fields[each].is_required()
        }
        law = law_of_entry(scene, key).recorded({**whole, **entry})
        found = getattr(law, path.place[1])
        assert (found[path.place[2]] if len(path.place) == 3 else found) == value


@pytest.mark.parametrize("key", SceneSection.NUMBERS)
def test_a_length_or_the_end_time_of_a_scene_is_a_path(key):
    path = find_path(key, SCENE)
    assert path.place == (key,)
    assert with_number({}, path, 0.25) == {key: 0.25}
    assert given_at(SCENE, path) == ((key,) if key in SCENE else None)


@pytest.mark.parametrize(
    "name",
    [
        "particles",
        "engine.budget",
        "solver.tolerance",
        "restitution.law",
        "restitution",
        "velocities",
        "velocities.mean",
        "velocities.mean.3",
        "velocities.mean.x",
        "velocities.transverse.0",
        "restitution.value",  # of another law
        "sizes.spread",  # of none
        "cooling.emissivity",  # of a law that the scene leaves out
        "scene.end_time",
        "title",
        "",
        ".",
    ],
)
def test_what_is_no_number_of_the_scene_is_refused(name):
    with pytest.raises(ValueError, match=r"\w"):
        find_path(name, SCENE)


def test_a_law_that_is_left_out_has_the_numbers_of_its_default():
    assert "duration.length_ratio" in paths_of(SCENE)
    path = find_path("duration.length_ratio", SCENE)
    assert with_number(SCENE, path, 2.0)["duration"] == {
        "law": "compression_recovery",
        "length_ratio": 2.0,
    }


def test_one_of_several_numbers_keeps_the_others():
    path = find_path("velocities.mean.2", SCENE)
    assert with_number(SCENE, path, 1.5)["velocities"]["mean"] == [10.0, 10.0, 1.5]
    given_two = {**SCENE, "velocities": {"law": "spread", "mean": [1.0, 2.0, None]}}
    assert given_at(given_two, path) is None
    assert with_number(given_two, path, 1.5)["velocities"]["mean"] == [1.0, 2.0, 1.5]
    whole = {**SCENE, "velocities": {"law": "spread", "mean": [1.0, 2.0, 3.0]}}
    assert given_at(whole, path) == ("velocities", "mean", 2)


@given(st.text(max_size=80) | st.lists(st.text(max_size=8), max_size=5).map(".".join))
def test_any_text_is_a_path_or_refused(name):
    if name in paths_of(SCENE):
        assert find_path(name, SCENE).name == name
    else:
        with pytest.raises(ValueError, match=r"\w"):
            find_path(name, SCENE)


@given(
    st.sampled_from(sorted(paths_of(SCENE))),
    st.floats(1e-3, 1.0),
)
def test_a_number_stands_where_it_was_put(name, value):
    path = find_path(name, SCENE)
    found = with_number(SCENE, path, value)
    for key in path.place:
        found = found[key]
    assert found == value


def test_laws_are_found_by_kind():
    assert all(issubclass(law_of_entry(scene_with(*law), law[0]), Component) for law in laws())
