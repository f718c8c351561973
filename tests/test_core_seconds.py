"""What the plugin books, sums and compares."""

import time
from collections import Counter
from pathlib import Path

import pytest
from core_seconds import PARTS, Account, budgets, excesses, folder_of, kind_of, table_of

TESTS = Path(__file__).parent


def spend(seconds):
    end = time.process_time() + seconds
    while time.process_time() < end:
        pass


def test_time_is_booked_on_the_innermost_part():
    account = Account()
    account.settle("tests")
    account.begin("campaigns")
    account.begin("compiling")
    spend(0.02)
    account.end("compiling")
    account.end("campaigns")
    spend(0.02)
    spent = account.settle("tests")
    assert spent["compiling"] >= 0.02
    assert spent["tests"] >= 0.02
    assert spent.get("campaigns", 0.0) < spent["compiling"]
    assert set(spent) <= set(PARTS)


def test_a_folder_is_that_below_tests():
    assert folder_of("tests/mpi/test_mpi_same.py") == "mpi"
    assert folder_of("tests/report/figures/test_growth.py") == "report"
    assert folder_of("tests/test_guards.py") == "tests"
    assert folder_of("importing") == "importing"


def test_a_folder_may_take_twice_its_budget():
    assert excesses({"mpi": 20.0}, {"mpi": 10}) == []
    assert len(excesses({"mpi": 20.1, "new": 1.0}, {"mpi": 10})) == 2
    assert excesses({"mpi": 20.1}, {}) == []


@pytest.mark.parametrize("tier", ["quick", "slow"])
def test_every_folder_of_tests_has_a_budget(tier):
    folders = {path.parent.relative_to(TESTS).parts[:1] for path in TESTS.rglob("test_*.py")}
    assert {each[0] if each else "tests" for each in folders} | {"importing"} == set(budgets(tier))


def test_a_table_has_a_line_for_each_file_and_the_sum():
    files = {"a.py": Counter(tests=1.0), "b.py": Counter(tests=2.0, compiling=3.0)}
    head, first, second, last = table_of(files).splitlines()
    assert (first.split()[-1], second.split()[-1]) == ("b.py", "a.py")
    assert head.split() == ["sum", *PARTS, "file"]
    assert float(last.split()[0]) == pytest.approx(6.0)


def test_the_quick_tier_lists_at_most_eight_kinds_of_scene():
    listed = budgets("compiled")["quick"]
    assert len(listed) == len(set(listed)) <= 8


def test_a_kind_of_scene_is_known_by_its_laws():
    laws = "ImpactLaws(ConstantRestitution(float64 x 2), none, none)"
    scene = f"Scene(Periodic(), {laws}, none, EventDriven(int64 x 1), UniTuple(float64 x 3), none)"
    assert kind_of((scene,)) == "Periodic ConstantRestitution EventDriven"
    sized = scene.replace("3), none)", "3), Lognormal(float64 x 1))")
    assert kind_of((sized,)).endswith("EventDriven Lognormal sizes")
    assert kind_of(("float64",)) == kind_of(()) == ""
