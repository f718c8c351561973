"""The section on the impact solver: its references, its counts, and what it concludes."""

import math
import subprocess
import sys

import numpy as np
import pytest
from matplotlib.figure import Figure

from agglom_mpi.accuracy.impact_methods import (
    CAPS,
    PAIR,
    ROOT,
    TOLERANCES,
    hardness_of,
    impact_laws,
    iterate_as_published,
    name_of,
    outcomes,
    published_iterations,
    solve_all,
    summary,
)
from agglom_mpi.accuracy.impact_reference import Material, closed_form, exact_impact, excess
from agglom_mpi.accuracy.impact_solver import impact_solver_section
from agglom_mpi.physics.impact_solvers import BracketedRoot, FixedPointIteration

X = np.logspace(-6.0, math.log10(0.98), 40)


@pytest.fixture(scope="module")
def section():
    return impact_solver_section(quick=True)


@pytest.fixture(scope="module")
def methods(section):
    return section.tables[0].frame.set_index("method")


@pytest.fixture(scope="module")
def impacts(section):
    return section.tables[1].frame


def test_every_number_is_finite_where_it_has_a_meaning(methods, impacts):
    assert len(methods) == 1 + len(CAPS) * len(TOLERANCES)
    for frame in (methods, impacts.set_index("method")):
        published = frame[frame.index != ROOT].select_dtypes("number")
        assert np.isfinite(published.to_numpy(float)).all()
        without = frame.drop(columns=["cap", "tolerance"]).filter(regex="^(?!.*iterations)")
        assert np.isfinite(without.select_dtypes("number").to_numpy(float)).all()
    assert (methods["processor time per impact (s)"] > 0.0).all()


def test_the_root_finder_solves_every_impact_to_rounding(methods, impacts):
    own = impacts[impacts["method"] == ROOT]
    assert own["closed form"].sum() > 20
    assert (own["error of e"] < 1e-12).all()
    assert not own["capped"].any()
    assert methods.loc[ROOT, "solved"] == methods.loc[ROOT, "bounces"]


def test_every_method_bonds_the_pairs_that_bond(methods):
    assert (methods["wrongly bonded or not"] == 0).all()


def test_without_initial_area_the_published_iteration_cycles_to_its_cap(impacts):
    hard = impacts[(impacts["a0"] == 0.0) & (impacts["softening"] == "none") & ~impacts["bonds"]]
    published = hard[hard["method"] != ROOT]
    assert published["capped"].all()
    assert (published["iterations"] == published["cap"]).all()
    assert (published["error of e"] > 1e-6).all()


def test_more_iterations_solve_no_fewer_impacts(methods):
    for tolerance in TOLERANCES:
        solved = [methods.loc[name_of(cap, tolerance), "solved"] for cap in CAPS]
        assert solved == sorted(solved)


def test_the_conclusions_say_what_the_tables_say(section, methods, impacts):
    text = "\n".join(section.conclusions)
    for cap in CAPS:
        row = methods.loc[name_of(cap, 1e-6)]
        assert f"cap of {cap} and a tolerance of 1e-06" in text
        assert f"within 1e-06 in {row['solved']:.0f} of {row['bounces']:.0f} impacts" in text
    speeds = impacts.loc[~impacts["bonds"], "X"].nunique()
    assert f"[B] and a₀ = 0 it converges in 0 of {speeds} impacts, for no X" in text
    row = methods.loc[name_of(10, 1e-9)]
    failure = (
        f"{name_of(10, 1e-9)}: of {row['bounces']:.0f} bounces, {row['capped']:.0f} end at the cap"
    )
    assert any(line.startswith(failure) for line in section.failures)
    assert not any(line.startswith(ROOT) for line in section.failures)


def test_other_data_give_other_conclusions(impacts):
    worse = impacts.copy()
    root = (worse["method"] == ROOT) & ~worse["bonds"]
    worse.loc[root, "error of e"] = 0.5
    worse.loc[root, "capped"] = True
    row = summary(worse).set_index("method").loc[ROOT]
    assert (row["solved"], row["capped"], row["worst error of e"]) == (0, root.sum(), 0.5)
    assert set(outcomes(worse[root])) == {3}


def test_the_figures_and_the_table_can_be_drawn(section):
    for figure in section.figures:
        canvas = Figure(layout="constrained")
        figure.draw(canvas)
        assert canvas.axes[0].get_xlabel()
    for column in section.tables[0].shown:
        assert all(column.text(row) for _, row in section.tables[0].frame.iterrows())


@pytest.mark.parametrize("mean_speed", [True, False])
@pytest.mark.parametrize("cap", [10, 137])
def test_the_counted_iteration_is_the_packages(mean_speed, cap):
    for material in (Material(mean_speed, 0.01, 0.0, 0.0), Material(mean_speed, 0.1, 20.0, 1.0)):
        laws = impact_laws(material, FixedPointIteration.Numbers(1e-6, cap))
        hardness = hardness_of(material, X)
        found = solve_all(laws, hardness)
        deficits, counts = np.empty(len(X)), np.empty(len(X), np.int64)
        iterate_as_published(laws, PAIR, hardness, deficits, counts)
        assert np.array_equal(deficits, found.deficit)
        assert np.array_equal(counts, published_iterations(laws, hardness))
        assert (counts[found.capped] == cap).all()
        assert (counts[~found.capped & ~found.bonds] <= cap).all()


@pytest.mark.parametrize("mean_speed", [True, False])
@pytest.mark.parametrize("initial", [0.0, 0.01, 1.0])
def test_the_brute_force_finds_the_closed_form_where_next_to_nothing_softens(mean_speed, initial):
    for x in X[::4].tolist():
        searched = exact_impact(Material(mean_speed, initial, 1e-13, 1e-3), x)
        assert (searched.closed, searched.roots) == (False, 1)
        expected = closed_form(Material(mean_speed, initial, 0.0, 0.0), x)
        assert searched.deficit == pytest.approx(expected, rel=1e-15)


def test_the_closed_form_solves_its_equation():
    for mean_speed, initial in ((True, 0.0), (True, 0.3), (False, 0.0), (False, 0.3)):
        material = Material(mean_speed, initial, 0.0, 0.0)
        for x in X.tolist():
            logarithm = np.log(np.longdouble(closed_form(material, x)))
            assert abs(excess(material, x, logarithm)) < 1e-14


@pytest.mark.parametrize("mean_speed", [True, False])
def test_two_roots_that_nearly_touch_are_told_from_none(mean_speed):
    """The brute force and the package agree on both sides of a fold."""
    material = Material(mean_speed, 0.0, 20.0, 1.0)
    grid = np.linspace(-2.0, 0.0, 2_000_001)
    top = excess(material, 1.0, grid)
    fold = grid[np.argmax(top)]
    for gap in (-1e-9, 1e-9):
        x = math.exp(-float(top.max()) + gap)
        exact = exact_impact(material, x)
        laws = impact_laws(material, BracketedRoot.Numbers())
        found = solve_all(laws, hardness_of(material, np.array([x])))
        assert (math.log(exact.deficit) > fold - 1e-3) == (gap > 0.0)
        # At a fold e moves with the square root of what r is rounded by.
        error = 1e-6 if gap > 0.0 else 1e-12
        assert found.deficit[0] == pytest.approx(exact.deficit, abs=error)


def test_importing_the_sections_imports_no_library_of_the_report():
    code = (
        "import sys, agglom_mpi.accuracy.impact_solver, agglom_mpi.accuracy.cooling;"
        "print(sorted({'pandas', 'matplotlib', 'jinja2'} & set(sys.modules)))"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert done.stdout.strip() == "[]", done.stderr
