"""Stability maps: where scenes lie, what fails and why, and the cell that reproduces it."""

import numpy as np
import pytest
from accuracy_rows import frame_of, made_up
from matplotlib.figure import Figure

from agglom_mpi.accuracy.maps.cells import Cell
from agglom_mpi.accuracy.maps.command import needs_samples, plane_names
from agglom_mpi.accuracy.maps.plane_map import COLLAPSE, REFUSED, MapSize, PlaneMap
from agglom_mpi.accuracy.maps.planes import DEFAULT, LASTING, PLANES, points
from agglom_mpi.accuracy.maps.scene import file_text, map_scene
from agglom_mpi.accuracy.maps.section import plane_section
from agglom_mpi.config.campaign import Campaign
from agglom_mpi.config.loading import load_campaign
from agglom_mpi.config.yaml_source import CampaignError

SIZE = MapSize(grid=4, levels=2, samples=4, grains=30, budget=1000, quick=True)
JOBS = ("jobs/accuracy/accretion_2003_row_1.yaml", "jobs/accuracy/agglomeration_2004_row_1.yaml")


@pytest.fixture(scope="module", params=JOBS, ids=["A", "B"])
def scene(request):
    return map_scene(load_campaign(request.param), {}, SIZE.grains, SIZE.budget)


@pytest.mark.parametrize("name", PLANES)
def test_a_cell_has_the_numbers_of_its_place(scene, name):
    plane = PLANES[name]
    for across, up in ((0.15, 0.2), (0.5, 0.5), (0.6, 0.85)):
        x, y = plane.x.value(across), plane.y.value(up)
        campaign = plane.campaign(scene, x, y)
        section, values = campaign.at(campaign.parameters())
        place = plane.point(section, values)
        # The steps of the plane of masses are those of its methods, not of the scene.
        expected = (x, place[1] if name == "masses" else y)
        assert place == pytest.approx(expected, rel=1e-9)


def test_the_steps_per_collision_of_a_method_are_those_of_its_place(scene):
    plane = PLANES["masses"]
    campaign = plane.campaign(scene, 8.0, 1.0)
    methods = {y: dict(plane.methods(campaign, y, True)) for y in (2.0, 20.0)}
    few, many = (methods[y]["fixed"].scene.engine.steps for y in (2.0, 20.0))
    assert many == pytest.approx(10 * few, abs=10)
    floors = [methods[y]["adaptive"].scene.engine.floor for y in (2.0, 20.0)]
    assert floors[0] == pytest.approx(10.0 * floors[1])


@pytest.mark.parametrize("name", PLANES)
def test_a_cell_as_a_file_is_the_same_string_bit_for_bit(scene, name):
    plane = PLANES[name]
    campaign = plane.campaign(scene, plane.x.value(0.3), plane.y.value(0.4))
    for method, own in plane.methods(campaign, plane.y.value(0.4), False):
        read = Campaign.from_text(file_text(own, "cell"))
        assert read.scene.entries() == own.scene.entries(), method
        assert read.parameters().tobytes() == own.parameters().tobytes()
        assert read.seed == own.seed


def test_grains_beyond_the_limit_are_left_out_with_their_part_of_the_box():
    campaign = load_campaign(JOBS[1])
    whole = map_scene(campaign, {}, 10**6, 1000)
    part = map_scene(campaign, {}, 125, 1000)
    cells = [scene.campaign({}) for scene in (whole, part)]
    assert [cell.scene.particles for cell in cells] == [1000, 125]
    radii = [cell.at(cell.parameters()).build().radius for cell in cells]
    assert radii[0] == pytest.approx(radii[1], rel=1e-14)


def test_a_published_row_lies_where_its_numbers_are():
    campaign = load_campaign(JOBS[0])
    section, values = campaign.at(campaign.parameters())
    softening = points(PLANES["softening"], {"row": (section, values)})["row"]
    assert softening[0] == pytest.approx(707.351 / (8.314462618 * 330.652))
    # The pressure over 2 H0 is the square of the speed over the critical one, sqrt(6 H eps/rho).
    critical = np.sqrt(6.0 * 67.188e6 * 1e-6 / 6141.898)
    assert softening[1] == pytest.approx((4.326 / critical) ** 2, rel=1e-12)
    assert points(PLANES["collapse"], {"row": (section, values)}) == {}


def sound_rows(growth=(1.5, 1.6, 1.55, 1.45), **columns):
    return made_up(growth, collisions=10, energy_error=1e-14, **columns)


def exhausted():
    rows = sound_rows(failed=[0, 1, 2, 3])
    rows["reason"] = 3
    return rows


def collapse_map(rows_of):
    """Return the collapse map of [A] whose first level has made-up samples."""
    scene = map_scene(load_campaign(JOBS[0]), {}, SIZE.grains, SIZE.budget)
    found = PlaneMap(PLANES["collapse"], scene, SIZE)
    found.take(0, {name: rows_of(name) for name in found.setups(0)})
    return found


def test_an_exhausted_budget_is_documented_where_a_contact_time_ends_the_collapse():
    lasting_sound = collapse_map(
        lambda name: exhausted() if f", {DEFAULT}, cell 0 1" in name else sound_rows()
    )
    cell = lasting_sound.results[DEFAULT][Cell(0, 1, 0)]
    assert (list(cell.troubles), cell.excuse) == (["budget exhausted"], COLLAPSE)
    both = collapse_map(lambda name: exhausted() if "event" in name else sound_rows())
    assert both.results[DEFAULT][Cell(0, 1, 0)].excuse == ""
    assert not both.results[LASTING][Cell(0, 1, 0)].sound


def test_random_placement_is_refused_beyond_its_fraction_and_documented():
    found = collapse_map(lambda name: sound_rows())
    for cell, result in found.results[DEFAULT].items():
        fraction, _ = found.numbers(cell)
        assert (REFUSED in result.troubles) == (fraction > 0.38)
        assert bool(result.excuse) == (fraction > 0.38)
    assert not any("cell 0 3" in name for name in found.setups(0))


def test_the_cell_to_reproduce_is_the_most_serious_failure_without_an_excuse():
    def rows(name):
        if f", {DEFAULT}, cell 0 1" in name or name.endswith("adaptive, cell 0 0 2"):
            return exhausted()
        cold = ("200 steps, cell 0 1 0", f"{DEFAULT}, cell 0 2 1")
        if name.endswith(cold):
            return sound_rows(floored_temperatures=1)
        return sound_rows() if "event" in name else sound_rows(overlaps=3)

    found = collapse_map(rows)
    assert found.failing_cell("adaptive") == Cell(0, 0, 2)
    assert found.failing_cell("fixed, 200 steps") == Cell(0, 1, 0)
    assert any(result.excuse for result in found.results[DEFAULT].values())
    assert found.failing_cell(DEFAULT) == Cell(0, 2, 1)


def test_an_error_within_two_standard_errors_is_not_resolved():
    def rows(name):
        shift = 0.3 if "adaptive" in name else 0.01
        return (
            sound_rows()
            if f", {DEFAULT}," in name
            else sound_rows(np.array([1.5, 1.6, 1.55, 1.45]) + shift)
        )

    found = collapse_map(rows).results
    assert found["adaptive"][Cell(0, 0, 0)].resolved
    assert found["adaptive"][Cell(0, 0, 0)].error == pytest.approx(0.3 / 1.525)
    assert not found["fixed, 200 steps"][Cell(0, 0, 0)].resolved
    assert not found[DEFAULT][Cell(0, 0, 0)].resolved


def test_the_default_method_takes_the_refined_cells_of_all_others():
    def rows(name):
        upper = name.endswith(" 2") and "adaptive" in name
        return sound_rows(overlaps=3) if upper else sound_rows()

    found = collapse_map(rows)
    chosen = found.cells(1)
    asked = set().union(*chosen.values())
    assert set(chosen["adaptive"]) - set(chosen["fixed, 200 steps"])
    assert set(chosen[DEFAULT]) == set(chosen[LASTING]) == asked


def test_the_section_has_the_numbers_of_its_cells():
    def rows(name):
        return sound_rows(capped_iterations=1) if "fixed, 200 steps," in name else sound_rows()

    found = collapse_map(rows)
    lines = {"fixed, 200 steps": "agglom simulate cell.yaml"}
    section = plane_section(found, {}, lines)
    table = frame_of(section.tables[0]).set_index("method")
    assert table.loc["fixed, 200 steps", "sound"] == 0.0
    assert table.loc[DEFAULT, "sound"] == pytest.approx(3.0 / 4.0)
    assert table.loc[DEFAULT, "failing, documented"] == pytest.approx(1.0 / 4.0)
    assert table.loc[DEFAULT, "failing cells, not documented"] == 0
    assert any("`agglom simulate cell.yaml`" in line for line in section.failures)
    assert len(section.conclusions) == 1
    for drawing in section.figures:
        canvas = Figure(layout="constrained")
        drawing.draw(canvas)
        assert len([ax for ax in canvas.axes if ax.get_title()]) == len(table)
    assert all(map(all, section.tables[0].cells))


def test_an_unknown_plane_is_named_with_what_is_allowed():
    with pytest.raises(CampaignError, match=r"is 'colapse'; allowed: all, softening"):
        plane_names("heat,colapse")
    assert plane_names("all") == (*PLANES, "impact", "cooling")


def test_the_names_of_planes_tell_whether_anything_is_simulated():
    for names, expected in (("impact,cooling", False), ("impact,heat", True), ("all", True)):
        assert needs_samples(names) == expected
