"""What changes the digest of the sources that decide, and what does not."""

import shutil

import pytest

from agglom_mpi.runtime.file_setup import PACKAGE, sources_digest

SAME = [
    ("search/ensemble.py", "its samples in order", "all samples in order"),
    ("physics/cooling.py", "\n\n\n", "\n\n\n# A remark.\n"),
    ("config/describe.py", "def ", "def other_"),
    ("report/page.py", "def ", "def other_"),
]
OTHER = [
    ("physics/constants.py", "8.314462618", "8.314462619"),
    ("search/ensemble.py", "10 * (failed", "11 * (failed"),
    ("config/campaign.py", "first_sample", "other_sample"),
    ("runtime/experiment.py", "best.setdefault(", "best.update("),
    ("analysis/warm_start.py", "parameters_of(begun)", "parameters_of(begun)[::-1]"),
    ("analysis/ranking.py", "sorted(", "list("),
    ("kernels.py", '"forceinline": True', '"forceinline": False'),
]


@pytest.fixture
def package(tmp_path):
    copy = tmp_path / "agglom_mpi"
    shutil.copytree(PACKAGE, copy, ignore=shutil.ignore_patterns("__pycache__"))
    return copy


def edited(package, name, old, new):
    path = package / name
    text = path.read_text()
    assert old in text
    path.write_text(text.replace(old, new))
    return sources_digest(package)


def test_a_copy_has_the_same_digest(package):
    assert sources_digest(package) == sources_digest()


@pytest.mark.parametrize(("name", "old", "new"), SAME)
def test_a_better_sentence_changes_nothing(package, name, old, new):
    assert edited(package, name, old, new) == sources_digest()


@pytest.mark.parametrize(("name", "old", "new"), OTHER)
def test_another_decision_is_seen(package, name, old, new):
    assert edited(package, name, old, new) != sources_digest()
