"""What changes the digest of the sources that decide, and what does not."""

import ast
import shutil
import sys
from types import FunctionType

import numpy as np
import pytest
from campaign_runs import TINY, write_campaign

from agglom_mpi.config.loading import load_campaign
from agglom_mpi.declaration.components import Component
from agglom_mpi.runtime import experiment as experiment_module
from agglom_mpi.runtime.provenance import DECIDING, NOT_DECIDING, PACKAGE, sources_digest
from agglom_mpi.runtime.task_runner import SampleRunner
from agglom_mpi.scheduling.interface import task_type

SAME = [
    ("search/ensemble.py", "its samples in order", "all samples in order"),
    ("physics/cooling.py", "\n\n\n", "\n\n\n# A remark.\n"),
    ("config/describe.py", "def ", "def other_"),
    ("config/consequences.py", "mean free path", "free path"),
    ("config/searchable.py", "allow {share} of the box; a narrower", "allow {share}; a narrower"),
    ("config/campaign.py", "must be event, fixed", "must be one of event, fixed"),
    ("physics/sizes.py", "must ", "has to "),
    ("report/page.py", "def ", "def other_"),
]
OTHER = [
    ("physics/constants.py", "8.314462618", "8.314462619"),
    ("statistics.py", "10 * failed", "11 * failed"),
    ("config/campaign.py", "first_sample", "other_sample"),
    ("config/searchable.py", "campaign.plan is None", "campaign.plan is not None"),
    ("config/identity.py", '"seed"', '"sown"'),
    ("runtime/experiment.py", "best.setdefault(", "best.update("),
    ("analysis/warm_start.py", "parameters_of(begun)", "parameters_of(begun)[::-1]"),
    ("analysis/ranking.py", "sorted(", "list("),
    ("compilation/kernels.py", '"forceinline": True', '"forceinline": False'),
]


@pytest.fixture
def package(tmp_path):
    copy = tmp_path / "agglom_mpi"
    shutil.copytree(PACKAGE, copy, ignore=shutil.ignore_patterns("__pycache__"))
    return copy


def edit(package, name, old, new):
    path = package / name
    text = path.read_text()
    assert old in text
    path.write_text(text.replace(old, new))


def test_a_copy_has_the_same_digest(package):
    assert sources_digest(package) == sources_digest()


def test_better_sentences_change_nothing(package):
    for name, old, new in SAME:
        edit(package, name, old, new)
    assert sources_digest(package) == sources_digest()


@pytest.mark.parametrize(
    ("name", "old", "new"),
    [*OTHER[:2], *(pytest.param(*each, marks=pytest.mark.slow) for each in OTHER[2:4])],
)
def test_another_decision_is_seen(package, name, old, new):
    edit(package, name, old, new)
    assert sources_digest(package) != sources_digest()


BEGUN_BY = (
    *("config/loading.py", "runtime/experiment.py", "runtime/task_runner.py"),
    "runtime/certify.py",
)
"""Modules that lead a run from a text to samples and decisions."""
LOOKED_AT_FIRST = ("analysis/warm_start.py",)
"""A counted module that the run time itself calls."""
ANSWERS = ("description", "describe", "warnings")
"""Methods of a `Campaign` that no run calls for its results."""


def imported(path):
    """Yield the package's modules that a module imports, but for those of `ANSWERS`, as paths."""

    def nodes(node, within):
        for child in ast.iter_child_nodes(node):
            if within == "Campaign" and getattr(child, "name", "") in ANSWERS:
                continue
            if isinstance(child, ast.If) and "TYPE_CHECKING" in ast.unparse(child.test):
                continue
            yield child
            yield from nodes(child, child.name if isinstance(child, ast.ClassDef) else within)

    for node in nodes(ast.parse(path.read_bytes()), ""):
        names = []
        if isinstance(node, ast.Import):
            names = [alias.name for alias in node.names]
        elif isinstance(node, ast.ImportFrom) and node.module:
            names = [node.module, *(f"{node.module}.{alias.name}" for alias in node.names)]
        for name in names:
            root, *parts = name.split(".")
            if root == "agglom_mpi" and parts and (PACKAGE.joinpath(*parts)).suffix == "":
                found = PACKAGE.joinpath(*parts).with_suffix(".py")
                if found.exists():
                    yield found.relative_to(PACKAGE).as_posix()


def counted():
    names = {p.relative_to(PACKAGE).as_posix() for each in DECIDING for p in PACKAGE.glob(each)}
    return {name for name in names if not name.endswith("__init__.py")}


def of_components(kind=Component):
    """Yield the modules of all components, which a campaign's text names, as paths."""
    kind.components()
    for below in kind.__subclasses__():
        yield below.__module__.removeprefix("agglom_mpi.").replace(".", "/") + ".py"
        yield from of_components(below)


def test_every_counted_module_takes_part_in_a_run():
    declared = [name for name in of_components() if (PACKAGE / name).is_file()]
    reached, new = set(), [*BEGUN_BY, *LOOKED_AT_FIRST, *declared]
    while new:
        name = new.pop()
        if name not in reached and name not in NOT_DECIDING:
            reached.add(name)
            new += imported(PACKAGE / name)
    assert counted() - set(NOT_DECIDING) - reached == set(), "name them in NOT_DECIDING"
    assert set(NOT_DECIDING) <= counted()


def refuse(*arguments, **options):
    raise AssertionError("a run has called what takes no part in it")


def test_a_run_calls_nothing_that_is_not_counted(tmp_path, monkeypatch):
    left_out = {f"agglom_mpi.{name[:-3].replace('/', '.')}" for name in NOT_DECIDING}
    for module in [m for name, m in sys.modules.items() if name.startswith("agglom_mpi")]:
        for name, value in list(vars(module).items()):
            if isinstance(value, FunctionType) and value.__module__ in left_out:
                monkeypatch.setattr(module, name, refuse)
    campaign = load_campaign(write_campaign(tmp_path / "tiny.yaml", **TINY))
    work = experiment_module.InversionExperiment(campaign)
    runner = SampleRunner(work, 0)
    work.identity()
    work.inversion(restore=None)
    batch = np.zeros(1, task_type(10))
    batch["count"], batch["parameters"] = 2, campaign.parameters()
    task = runner.begin(batch[0])
    while task.simulate_next():
        pass
    finished = task.collect()
    assert finished.results["state"].tolist() == [1, 1]
    assert len(finished.failures) == 0
