"""A stand-in has the numbers of a component of one's own, answers as it did, has no formulas."""

import json

import pytest

from agglom_mpi.config.own_components import RecordedComponents
from agglom_mpi.declaration.own_modules import OwnModule, class_in
from agglom_mpi.declaration.stand_ins import record_of, stand_in
from agglom_mpi.errors import CodeNotAllowedError
from agglom_mpi.physics.cooling import Cooling
from agglom_mpi.physics.sizes import Sizes
from agglom_mpi.search.methods.method import SearchMethod
from agglom_mpi.search.objectives.objective import Objective

SOURCE = '''
import math
from typing import Annotated, ClassVar, Literal

from agglom_mpi.components import *


class Newton(SteppableCooling):
    """Newton's law."""

    rate: Annotated[float, In("1/s", above=0, meaning="a rate like '2 Hz'")]
    limits: Annotated[tuple[float, float], In("K", at_least=0)] = (200.0, 900.0)
    order: Annotated[int, Whole(at_least=1)] = 1
    kind: Literal["slow", "fast"] = "slow"
    integration: Integration = "exact"
    later: Annotated[Annotated[float, In("1")] | None, LATER] = None
    variables = ("heat_capacity",)
    longest_step = "1/rate"
    groups = (Group("kt", "rate", {"heat_capacity": 1.0}),)

    @property
    def summary(self):
        return f"Newton's law, {self.rate:g}/s"

    @property
    def half_life(self):
        return math.log(2.0) / self.rate

    def is_frame_dependent(self):
        return self.rate > 1.0

    def cooling_rate(self, temperature, surface, capacity):
        return self.rate * temperature

    def exact_temperature(self, temperature, surface, capacity, time):
        return temperature * math.exp(-self.rate * time)

    @property
    def broken(self):
        raise SystemExit(0)


class Bimodal(Sizes):
    """Two sizes."""

    ratio: Annotated[float, In("1", above=1)]
    summary: ClassVar[str] = "two sizes"
    mean_diameter: ClassVar[float | None] = None

    def build(self):
        return LognormalDistribution(math.log(self.ratio))


class Sum(Objective):
    """A sum."""

    least: ClassVar[float] = -3.0
    summary: ClassVar[str] = "a sum"

    def accumulator(self):
        return MeanAccumulator(lambda outcome: outcome.mean_radius_ratio)

    def of_samples(self, rows):
        return rows["mean_radius_ratio"]

    def influence_values(self, outcomes):
        return [each.mean_radius_ratio for each in outcomes]


class Few(SearchMethod):
    """Few strings."""

    first: Annotated[int, Whole(at_least=1)] = 7
    summary: ClassVar[str] = "few strings"
    population: ClassVar[int] = 2

    @property
    def first_generation(self):
        return self.first

    def strings(self, generations):
        return self.first + 2 * (generations - 1)

    def build(self, inputs):
        raise AssertionError
'''
OWN = OwnModule.of("mine.py", SOURCE.encode())


def standing_in(kind, name, **values):
    """Return a component of that module, and the stand-in of its record with the same numbers."""
    component = class_in(OWN, name)(**values)
    record = json.loads(json.dumps(record_of(component)))
    made = stand_in(kind, component.name, record)
    return component, made.recorded(component.entries()), made


def test_it_has_the_fields_with_units_limits_and_defaults():
    component, other, made = standing_in(Cooling, "Newton", rate=2.0)
    assert other.entries() == component.entries()
    assert (other.name, other.own.sha256) == ("mine.py:Newton", OWN.sha256)
    read = made.checked({"law": "mine.py:Newton", "rate": "3 Hz", "limits": ["0 degC", 400]})
    assert (read.rate, read.limits, read.order, read.kind) == (3.0, (273.15, 400.0), 1, "slow")
    for wrong in ({}, {"rate": 0}, {"rate": "1 kg"}, {"rate": 1, "kind": "no"}, {"rat": 1}):
        with pytest.raises(ValueError, match="error"):
            made.checked({"law": "mine.py:Newton", **wrong})


def test_it_answers_as_the_class_did_and_has_no_formulas():
    component, other, _ = standing_in(Cooling, "Newton", rate=2.0)
    for name in ("summary", "variables", "longest_step", "groups", "half_life", "by_steps"):
        assert getattr(other, name) == getattr(component, name)
    assert other.groups[0].powers == {"heat_capacity": 1.0}
    assert other.is_frame_dependent() is True
    for formula in (
        lambda: other.cooling_rate(300.0, 1.0, 1.0),
        lambda: other.build({"heat_capacity": 1.0}),
        lambda: other.integrated({"heat_capacity": 1.0}, True),
        lambda: other.broken,
    ):
        with pytest.raises(CodeNotAllowedError, match="Newton"):
            formula()


def test_what_was_calculated_of_other_numbers_is_not_known():
    _, _, made = standing_in(Cooling, "Newton", rate=2.0)
    changed = made(rate=3.0)
    assert changed.variables == ("heat_capacity",)
    assert changed.summary == "Newton's law, 2/s"
    with pytest.raises(CodeNotAllowedError):
        _ = changed.half_life
    with pytest.raises(CodeNotAllowedError):
        changed.is_frame_dependent()


def test_a_law_of_sizes_keeps_its_moments_and_quantiles():
    component, other, made = standing_in(Sizes, "Bimodal", ratio=1.4)
    law, recorded = component.size_law, other.size_law
    assert [recorded.moment(k) for k in range(7)] == [law.moment(k) for k in range(7)]
    assert recorded.third_moment == law.third_moment
    for share in (0.1, 0.5, 0.9):
        for by_volume in (False, True):
            quantile = law.quantile(share, by_volume)
            assert recorded.quantile(share, by_volume) == pytest.approx(quantile, rel=1e-12)
    with pytest.raises(CodeNotAllowedError):
        recorded.draw(None, 3)
    with pytest.raises(CodeNotAllowedError):
        _ = made(ratio=1.5).size_law


def test_an_objective_keeps_its_flags_and_a_search_its_numbers():
    objective, other, _ = standing_in(Objective, "Sum")
    assert other.of_grains(8).least == objective.least == -3.0
    with pytest.raises(CodeNotAllowedError):
        other.accumulator()
    search, other, _ = standing_in(SearchMethod, "Few", first=9)
    assert [other.strings(g) for g in (1, 2, 9)] == [search.strings(g) for g in (1, 2, 9)]
    assert (other.first_generation, other.population, other.first_sample(4)) == (9, 2, 0)
    with pytest.raises(CodeNotAllowedError):
        other.build(None)


def test_a_stand_in_is_no_component_of_the_package():
    _, _, made = standing_in(Cooling, "Newton", rate=2.0)
    assert made not in Cooling.components().values()


def test_a_base_class_of_another_version_is_that_of_the_kind():
    record = json.loads(json.dumps(record_of(class_in(OWN, "Newton")(rate=2.0))))
    for base in ("agglom_mpi.physics.cooling:Gone", "os:path", "subprocess:Popen"):
        assert stand_in(Cooling, "mine.py:Newton", record | {"base": base}).__mro__[1] is Cooling


def altered(record):
    """Yield copies of a record, each with another value, or a name, that is something else."""
    for section in record:
        for value in (None, 3, "x", [], {}, ["__class__"], {"__call__": 1}, {"a b": {"is": "In"}}):
            yield {**record, section: value}
    for name, field in record["fields"].items():
        for key in (*field, "several", "allowed", "is"):
            for value in (None, -1, 10**9, 10**400, "x", [], {}):
                fields = {**record["fields"], name: {**field, key: value}}
                yield {**record, "fields": fields}


@pytest.mark.parametrize(("kind", "name"), [(Cooling, "Newton"), (Sizes, "Bimodal")])
def test_a_hostile_record_is_a_stand_in_or_one_error(kind, name):
    component = class_in(OWN, name)(**({"rate": 2.0} if name == "Newton" else {"ratio": 1.4}))
    record = json.loads(json.dumps(record_of(component)))
    found = {"made": 0, "refused": 0}
    for each in altered(record):
        texts = {"own_components": json.dumps({component.name: each})}
        try:
            made = RecordedComponents(texts).find(component.name, kind)
        except ValueError:  # any other error would be a traceback
            found["refused"] += 1
        else:
            assert made.own.file == "mine.py" or each["file"] != "mine.py"
            found["made"] += 1
    assert found["made"] > 10
    assert found["refused"] > 30


@pytest.mark.parametrize("count", [0, -1, 1001, 10**7])
def test_a_recorded_number_of_numbers_is_bounded(count):
    component = class_in(OWN, "Newton")(rate=2.0)
    record = json.loads(json.dumps(record_of(component)))
    assert record["fields"]["limits"]["several"] == 2
    record["fields"]["limits"]["several"] = count
    with pytest.raises(ValueError, match="too many"):
        stand_in(Cooling, component.name, record)


def test_a_stand_in_has_the_values_that_the_module_had_read(monkeypatch):
    monkeypatch.setenv("WALL", "0.5")
    source = SOURCE.replace(
        "class Newton", "import os\n\nWALL = os.environ['WALL']\n\n\nclass Newton"
    )
    body = "        return self.rate"
    assert body in source
    source = source.replace(body, f"{body} * float(WALL)", 1)
    component = class_in(OwnModule.of("mine.py", source.encode()), "Newton")(rate=2.0)
    assert component.entries()["source_values"] == {"WALL": "'0.5'"}
    record = json.loads(json.dumps(record_of(component)))
    made = stand_in(Cooling, component.name, record)
    assert made.recorded(component.entries()).entries() == component.entries()
