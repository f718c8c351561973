"""What is said of extreme scenes, on made-up samples."""

import pytest
from accuracy_rows import made_up

from agglom_mpi.accuracy.time_integration import extremes
from agglom_mpi.config.loading import load_campaign


@pytest.fixture(scope="module")
def campaign():
    return load_campaign("jobs/accuracy/accretion_2003_row_1.yaml")


def section_of(scenes, samples):
    return extremes.extremes_part(scenes, 4).section(samples)


def test_what_goes_wrong_in_an_extreme_scene_is_said(campaign):
    scenes = {"calm": campaign, "wild": campaign}
    sound = {"collisions": 10, "energy_error": 1e-13, "momentum_error": 1e-15}
    broken = made_up(
        [1.5] * 8, failed=[0], collisions=10, capped_iterations=5, energy_error=-1e-3, overlaps=3
    )
    broken["reason"][0] = 2
    broken["floored_temperatures"] = 1
    samples = {
        "calm": made_up([1.5] * 8, **sound),
        "wild": made_up([1.5] * 8, **sound),
        extremes.published_name("calm"): made_up([1.5] * 8, **sound),
        extremes.published_name("wild"): broken,
    }
    found = section_of(scenes, samples)
    assert found.conclusions[0] == "Our method is sound in 2 of 2 extreme scenes."
    assert found.conclusions[1] == "The published method is sound in 1 of 2 extreme scenes."
    assert found.failures == (
        "`wild`, published: 1 of 8 samples failed (non-finite state); 50 % of impacts unsolved; "
        "temperatures below zero; energy error 0.001; 3 overlaps.",
    )


def test_heaps_of_pieces_may_overlap_and_what_never_breaks_may_not(campaign):
    heaps = made_up([1.5] * 4, collisions=10, breakups=2, overlaps=70)
    more = made_up([1.5] * 4, collisions=10, breakups=2, overlaps=90)
    names = [extremes.published_name(name) for name in ("same", "more", "solid")]
    published = dict(zip(names, (heaps, more, heaps), strict=True))
    ours = {"same": heaps, "more": heaps, "solid": made_up([1.5] * 4, collisions=10)}
    found = section_of(dict.fromkeys(ours, campaign), ours | published)
    expected = ("`more`, published: 90 overlaps.", "`solid`, published: 70 overlaps.")
    assert found.failures == expected
    assert "in 0 scenes, temperatures go below zero in 0" in found.conclusions[2]
    assert "spheres overlap that should not in 2." in found.conclusions[2]


def test_all_samples_may_fail(campaign):
    rows = made_up([0.0] * 4, failed=range(4))
    rows["reason"] = 3
    found = section_of({"calm": campaign}, {"calm": rows, extremes.published_name("calm"): rows})
    assert "4 of 4 samples failed (budget of steps or events exceeded)" in found.failures[0]
    assert all(found.tables[0].cells[0])
