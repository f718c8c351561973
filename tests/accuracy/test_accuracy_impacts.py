"""The references of impacts, and the map of the impact solvers against them."""

import math
import subprocess
import sys

import numpy as np
import pytest
from accuracy_rows import frame_of

from agglom_mpi.accuracy.maps.law_references import (
    PAIR,
    Material,
    brute_force,
    closed_form,
    exact_deficit,
    excess,
    impact_laws,
    solve_impact,
)
from agglom_mpi.accuracy.maps.laws import (
    ITERATION_CAPS,
    ROOT,
    ImpactPlane,
    law_section,
    solved_impacts,
)
from agglom_mpi.accuracy.maps.scene import map_scene
from agglom_mpi.config.loading import load_campaign
from agglom_mpi.formatting import format_percent
from agglom_mpi.physics.impact_solvers import BracketedRoot

X = np.logspace(-6.0, math.log10(0.98), 40)
PUBLISHED = tuple(f"published, cap {cap}" for cap in ITERATION_CAPS)


@pytest.fixture(scope="module")
def section():
    campaign = load_campaign("jobs/accuracy/accretion_2003_row_1.yaml")
    return law_section(ImpactPlane(map_scene(campaign, {}, 100, 1000)), quick=True)


@pytest.fixture(scope="module")
def cells(section):
    return frame_of(section.tables[1])


@pytest.fixture(scope="module")
def methods(section):
    return frame_of(section.tables[0]).set_index("method")


def test_the_root_finder_is_sound_in_the_whole_plane(methods, cells):
    own = cells[cells["method"] == ROOT]
    assert len(own) >= 64
    assert (own["error of e"] < 1e-12).all()
    assert (own["trouble"] == "").all()
    assert methods.loc[ROOT, "sound"] == pytest.approx(1.0)


def test_every_method_bonds_the_pairs_that_bond(cells):
    assert not (cells["trouble"] == "wrongly bonded or not").any()
    bonded = cells[cells["impact pressure over that of bonding"] >= 1.0]
    assert len(bonded) >= 8
    assert (bonded["error of e"] == 0.0).all()


def test_the_published_iteration_fails_in_part_of_the_plane_with_more_iterations_in_less(
    methods,
):
    sound = [methods.loc[name, "sound"] for name in PUBLISHED]
    assert 0.0 < sound[0] < 1.0
    assert sound == sorted(sound)


def test_without_initial_area_the_published_iteration_cycles_to_its_cap():
    for x in X.tolist():
        found = solved_impacts(Material(False, 0.0, 0.0, 0.0), x)
        assert {found[name].trouble for name in PUBLISHED} == {"at the cap"}
        assert min(found[name].error for name in PUBLISHED) > 1e-6
        assert found[ROOT].error < 1e-12


def test_the_conclusion_has_the_numbers_of_the_table(section, methods):
    (sentence,) = section.conclusions
    for share in methods["sound"]:
        assert format_percent(share) in sentence


@pytest.mark.parametrize("mean_speed", [True, False])
@pytest.mark.parametrize("initial", [0.0, 0.01, 1.0])
def test_the_brute_force_finds_the_closed_form_where_next_to_nothing_softens(mean_speed, initial):
    for x in X[::4].tolist():
        searched = brute_force(Material(mean_speed, initial, 1e-13, 1e-3), x)
        expected = closed_form(Material(mean_speed, initial, 0.0, 0.0), x)
        assert searched == pytest.approx(expected, rel=1e-15)


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
        exact = exact_deficit(material, x)
        found = solve_impact(impact_laws(material, BracketedRoot.Numbers(), x), PAIR)
        assert (math.log(exact) > fold - 1e-3) == (gap > 0.0)
        # At a fold e moves with the square root of what r is rounded by.
        error = 1e-6 if gap > 0.0 else 1e-12
        assert found[0] == pytest.approx(exact, abs=error)


def test_importing_the_maps_imports_no_library_of_the_report():
    code = (
        "import sys, agglom_mpi.accuracy.maps.laws, agglom_mpi.accuracy.maps.command;"
        "print(sorted({'pandas', 'matplotlib', 'jinja2'} & set(sys.modules)))"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert done.stdout.strip() == "[]", done.stderr
