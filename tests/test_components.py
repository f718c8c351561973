"""Nothing outside of a component asks for its name or its class: it asks the component."""

import ast
from pathlib import Path

import pytest

import agglom_mpi.config.campaign
from agglom_mpi.declaration.components import Component

PACKAGE = Path(agglom_mpi.__file__).parent
SOURCES = sorted(
    path for path in PACKAGE.rglob("*.py") if PACKAGE / "declaration" not in path.parents
)
NAMES = ("law", "method", "rule")
"""Keys by which a campaign file names a component."""
RECORDED = ("law", "objective.law", "search.method", "ensemble.rule")
"""Keys of the same in mappings: the entries of a section, and the identity of a campaign."""


def classes_of_components():
    """Names of all classes of components, and of those among them that a file can name."""
    found, left = [], [Component]
    while left:
        kind = left.pop()
        kind.components()  # imports the modules that declare more
        left += kind.__subclasses__()
        if kind.__module__.startswith("agglom_mpi."):
            found.append(kind)
    return {kind.__name__ for kind in found}, {kind.__name__ for kind in found if kind.names()}


CLASSES, NAMED = classes_of_components()


def names_a_component(node):
    """Return whether an expression is the name of a component: `x.law`, `x["law"]`."""
    match node:
        case ast.Attribute(attr=name):
            return name in NAMES
        case ast.Subscript(slice=ast.Constant(value=str(name))):
            return name in RECORDED  # tables have columns with the names of the others
        case ast.Call(func=ast.Attribute(attr="get"), args=[ast.Constant(value=str(name)), *_]):
            return name in RECORDED
        case ast.Call(func=ast.Name(id="str"), args=[inner]):
            return names_a_component(inner)
    return False


def classes_in(node):
    """Return the classes of components, no base classes, that an expression names."""
    names = {each.id for each in ast.walk(node) if isinstance(each, ast.Name)}
    names |= {each.attr for each in ast.walk(node) if isinstance(each, ast.Attribute)}
    return names & NAMED


class Asking(ast.NodeVisitor):
    """Finds questions for a component's name or class outside of classes of components."""

    def __init__(self):
        self.found = []

    def visit_ClassDef(self, node):
        if node.name not in CLASSES:
            self.generic_visit(node)

    def visit_Compare(self, node):
        if any(map(names_a_component, [node.left, *node.comparators])):
            self.found.append(node.lineno)
        self.generic_visit(node)

    def visit_Match(self, node):
        if names_a_component(node.subject):
            self.found.append(node.lineno)
        for case in node.cases:
            for pattern in ast.walk(case.pattern):
                if isinstance(pattern, ast.MatchClass) and classes_in(pattern.cls):
                    self.found.append(pattern.lineno)
        self.generic_visit(node)

    def visit_Call(self, node):
        match node:
            case ast.Call(func=ast.Name(id="isinstance"), args=[_, kinds]) if classes_in(kinds):
                self.found.append(node.lineno)
            case ast.Call(func=ast.Name(id="getattr" | "hasattr"), args=[part, *_, _]) if (
                is_component(part, node)
            ):
                self.found.append(node.lineno)
        self.generic_visit(node)


SECTIONS = {
    *("scene", "objective", "search", "ensemble", "restitution", "cooling", "heating", "hardness"),
    *("velocities", "sizes", "engine", "friction", "reaction", "fragmentation", "solver", "law"),
    *("rule", "criterion", "component", "duration", "contact_area", "escape", "boundary"),
}
"""Names of variables and attributes whose values are components."""


def is_component(part, call):
    """Return whether `getattr(part, name, default)` or `hasattr(part, name)` asks a component."""
    name = part.attr if isinstance(part, ast.Attribute) else getattr(part, "id", "")
    with_default = call.func.id == "hasattr" or len(call.args) == 3
    return name in SECTIONS and with_default


def findings(path):
    asking = Asking()
    asking.visit(ast.parse(path.read_text()))
    return asking.found


@pytest.mark.parametrize("path", SOURCES, ids=lambda path: str(path.relative_to(PACKAGE)))
def test_nothing_asks_for_the_name_or_the_class_of_a_component(path):
    assert findings(path) == []


@pytest.mark.parametrize(
    "code",
    [
        'x = scene.restitution.law == "pressure"',
        'x = "event" != engine.law',
        'x = plan.ensemble.rule in ("fixed", "moments")',
        'x = entries["law"] not in known',
        'x = identity.get("search.method") == "surrogate"',
        'match entries["law"]:\n    case "function": pass',
        "match objective:\n    case GrowthTarget(): pass",
        "x = isinstance(campaign.objective, MeanOfFunction)",
        "x = isinstance(rule, (int, stopping.FixedNumber))",
        'x = getattr(scene.cooling, "integration", "euler")',
        'x = hasattr(engine, "steps")',
        "class Report:\n    def f(self): return self.campaign.search.method == 'genetic'",
    ],
)
def test_such_a_question_is_found(code):
    asking = Asking()
    asking.visit(ast.parse(code))
    assert asking.found


@pytest.mark.parametrize(
    "code",
    [
        "x = objective.is_magnitude",
        'x = frame[frame["name"] == 3]',
        "x = isinstance(path, Path)",
        'x = getattr(scene, "half_width")',
        'x = getattr(error, "errno", None)',
        "class GrowthTarget:\n    def f(self): return self.law == 'growth_target'",
    ],
)
def test_other_questions_are_none(code):
    asking = Asking()
    asking.visit(ast.parse(code))
    assert not asking.found
