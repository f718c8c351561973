"""Classes with declared fields: what their instances are, and how values are read."""

import copy
import pickle
import subprocess
import sys
from functools import cached_property
from typing import Annotated, ClassVar, Literal

import pytest

from agglom_mpi.declaration.components import In, Whole
from agglom_mpi.declaration.declared import LATER, NONE, Declared, FieldError


class Part(Declared):
    share: Annotated[float, In("1", above=0, below=1)] = 0.5


class Sample(Declared):
    unit: ClassVar[str] = "m"
    length: Annotated[float, In("m", above=0)]
    count: Annotated[int, Whole(at_least=1)] = 3
    part: Annotated[Part | None, NONE, LATER] = None
    _bound: float = 0.0

    def problems(self):
        if self.count > 10 * self.length:
            yield ("count",), "is too many"

    @cached_property
    def doubled(self):
        return 2.0 * self.length


def test_fields_are_what_is_annotated_with_limits_units_and_defaults():
    assert list(Sample.model_fields) == ["length", "count", "part"]
    assert Sample.model_fields["length"].is_required()
    assert Sample.model_fields["count"].default == 3
    one = Sample(length="50 cm", count=1e0)
    assert (one.length, one.count, one.part) == (0.5, 1, None)


@pytest.mark.parametrize(
    ("values", "field"),
    [
        ({}, "length"),
        ({"length": 0}, "length"),
        ({"length": "1 s"}, "length"),
        ({"length": 1, "count": 0}, "count"),
        ({"length": 1, "count": 2.5}, "count"),
        ({"length": 1, "part": {"share": 2}}, "part"),
        ({"length": 1, "width": 1}, "width"),
        ({"length": 1, "count": 11}, "count"),
    ],
)
def test_values_that_do_not_fit_are_refused_by_their_field(values, field):
    with pytest.raises(ValueError, match=field):
        Sample(**values)


class Mixed(Declared):
    word: Literal["mean", "spread"] = "mean"
    pair: tuple[int, float] = (1, 0.5)
    names: list[str] | None = None
    parts: dict[str, Part] | None = None
    flag: bool = False


def test_values_are_read_by_their_types():
    read = Mixed.checked({"pair": [2, 3], "names": None, "parts": {"a": {"share": 0.1}}})
    assert (read.pair, read.names, read.parts) == ((2, 3.0), None, {"a": Part(share=0.1)})
    assert isinstance(read.pair[1], float)
    assert read.model_fields_set == {"pair", "names", "parts"}


def test_all_wrong_values_are_named_at_once_with_their_places():
    wrong = {"word": "median", "pair": [1], "names": ["a", 3], "flag": 1, "more": 0}
    with pytest.raises(FieldError) as raised:
        Mixed.checked({**wrong, "parts": {"a": {"share": 2}, "b": 5}})
    places = [path for path, _ in raised.value.problems]
    inner = [("names", 1), ("parts", "a", "share"), ("parts", "b")]
    assert places == [("word",), ("pair",), *inner, ("flag",), ("more",)]


def test_an_error_of_several_fields_names_each():
    error = FieldError((("a", 1), "is wrong"), (("b",), "is missing"))
    assert str(error) == "a.1: is wrong; b: is missing"


def test_instances_are_equal_by_their_fields_and_cannot_be_changed():
    one, other = Sample(length=1.0), Sample(length=1.0, count=3)
    assert one == other
    assert hash(one) == hash(other)
    assert one.model_fields_set != other.model_fields_set
    assert one != Sample(length=2.0)
    assert one != Part()
    with pytest.raises(AttributeError, match="length"):
        one.length = 2.0


def test_copies_keep_what_is_bound_and_nothing_that_was_calculated():
    one = Sample(length=1.0)
    one.__dict__["_bound"] = 5.0
    assert one.doubled == 2.0
    longer = one.model_copy(update={"length": 3.0})
    assert (longer.doubled, longer._bound, longer.count) == (6.0, 5.0, 3)
    assert one != Sample(length=1.0)
    for again in (copy.deepcopy(one), pickle.loads(pickle.dumps(one))):
        assert again == one


def test_entries_leave_out_what_was_added_later_and_is_at_its_default():
    assert Sample(length=1.0).entries() == {"length": 1.0, "count": 3}
    whole = Sample(length=1.0, part={"share": 0.25})
    assert whole.entries() == {"length": 1.0, "count": 3, "part": {"share": 0.25}}
    assert Sample(length=1.0, part="none").part is None
    assert Sample.recorded(whole.entries()) == whole
    assert Sample(**whole.entries()) == whole


def test_what_is_recorded_is_taken_as_it_is():
    assert Sample.recorded({"length": -1.0, "other": 5}).length == -1.0
    with pytest.raises(ValueError, match="length"):
        Sample.recorded({"count": 1})


RECORDED = """
import sys
from agglom_mpi.search.methods.method import SearchMethod
from agglom_mpi.search.objectives.objective import Objective
from agglom_mpi.search.stopping import StoppingRule
Objective.of_entries({"law": "growth_target", "ratio": 2.0}).of_grains(100)
StoppingRule.of_entries({"rule": "fixed", "samples": 3})
assert SearchMethod.of_entries({"method": "surrogate"}).ranks_itself
genetic = {"method": "genetic", "blend": {"0": 0.0}}
assert not SearchMethod.of_entries(genetic).ranks_itself
assert SearchMethod.of_entries({**genetic, "more_samples": 5}).ranks_itself
assert not {"pint", "ruamel", "scipy"} & set(sys.modules)
"""


def test_recorded_components_load_neither_units_nor_scipy():
    done = subprocess.run([sys.executable, "-c", RECORDED], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
