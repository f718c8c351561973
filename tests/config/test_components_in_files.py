"""How entries of a file become components: defaults, wrong names, and what was recorded."""

import ast
from pathlib import Path
from types import SimpleNamespace

import pytest
from campaign_text import campaign

import agglom_mpi
from agglom_mpi.analysis.ranking import ranks_itself
from agglom_mpi.compilation.kernels import _KERNEL_SOURCES
from agglom_mpi.config.scene import SceneSection
from agglom_mpi.config.yaml_source import CampaignError
from agglom_mpi.declaration.choices import choice_of
from agglom_mpi.declaration.components import UnknownComponentError
from agglom_mpi.declaration.declared import FieldError
from agglom_mpi.declaration.reading import PLAIN
from agglom_mpi.physics.sizes import law_of_file
from agglom_mpi.search.methods.genetic import Genetic
from agglom_mpi.search.methods.method import SearchMethod
from agglom_mpi.search.objectives.growth import GrowthTarget
from agglom_mpi.search.objectives.objective import Objective

PACKAGE = Path(agglom_mpi.__file__).parent


@pytest.mark.parametrize("key", ["friction", "heating", "reaction", "fragmentation"])
def test_a_law_with_a_default_need_not_be_named(key):
    field = SceneSection.model_fields[key]
    choice = choice_of(field)
    assert choice.read({}, PLAIN).name == field.default.name
    with pytest.raises(FieldError, match="unknown"):
        choice.read({"unknown": 1}, PLAIN)


@pytest.mark.parametrize(("value", "said"), [("", "is empty"), ("1", "is 1"), ("[a]", "['a']")])
def test_a_wrong_name_is_quoted_as_it_stands_in_the_file(value, said):
    with pytest.raises(CampaignError) as raised:
        campaign(("  heating", f"  heating: {{law: {value}}}"))
    [problem] = raised.value.problems
    assert problem.field == "scene.heating.law"
    assert said in problem.message


@pytest.mark.parametrize("name", [["a"], {"a": 1}, None, 3])
def test_a_name_that_is_no_text_reads_no_file(name):
    assert not law_of_file({"law": name, "file": "sizes.csv"})


def test_a_search_of_a_later_version_ranks_by_objectives():
    data = SimpleNamespace(identity={"search.method": "annealing"}, reading=PLAIN)
    assert not ranks_itself(data)


@pytest.mark.parametrize(
    "entries", [{"ratio": 2.0}, {"law": "moments", "targets": {"sixth": 2.0}, "weights": {}}]
)
def test_entries_of_no_known_objective_are_refused(entries):
    with pytest.raises(UnknownComponentError):
        Objective.of_entries(entries)


def test_what_was_recorded_equals_what_was_given():
    given = Genetic(blend=(-0.5, 1.5))
    assert SearchMethod.of_entries({**given.entries(), "blend": [-0.5, 1.5]}) == given
    target = GrowthTarget(ratio=3.0)
    with pytest.raises(AttributeError):
        del target.ratio


def test_every_module_that_declares_stages_is_a_source_of_kernels():
    sources = {path for each in _KERNEL_SOURCES for path in PACKAGE.glob(each)}
    declaring = set()
    for path in PACKAGE.rglob("*.py"):
        for node in ast.walk(ast.parse(path.read_text())):
            if isinstance(node, ast.ImportFrom) and node.module in (
                "agglom_mpi.compilation.stages",
                "agglom_mpi.compilation.kernels",
            ):
                names = {alias.name for alias in node.names}
                if names & {"formula", "dispatch", "inlined", "not_inlined", "kernel"}:
                    declaring.add(path)
    studies = {path for path in declaring if "accuracy" in path.parts}
    assert declaring - studies - sources == set()
