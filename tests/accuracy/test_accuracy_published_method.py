"""The published method is another method for the same physics; its bias and failures, on made-up
samples."""

from pathlib import Path

import numpy as np
import pytest
from accuracy_rows import frame_of, made_up

from agglom_mpi.accuracy.study import with_scene
from agglom_mpi.accuracy.time_integration.published_method import (
    as_published,
    extremes_part,
    published_name,
)
from agglom_mpi.accuracy.time_integration.steps import (
    ITERATION,
    STEP,
    WHOLE,
    StudiedScene,
    published_setups,
    steps_part,
)
from agglom_mpi.config.loading import load_campaign
from agglom_mpi.config.scene import SceneSection

JOBS = Path(__file__).parents[2] / "jobs"
METHOD = {"engine", "solver", "cooling"}


def scene(**entries):
    box = {"particles": 10, "half_width": 0.01, "velocities": "uniform_x", "end_time": 1.0}
    return SceneSection.checked(box | entries)


@pytest.mark.parametrize(
    ("job", "engine"),
    [
        ("accretion_2003", {"law": "fixed", "steps": 200}),
        ("agglomeration_2004", {"law": "adaptive", "floor": 1e-6, "ceiling": 1e-3}),
    ],
)
def test_the_papers_scenes_get_the_papers_methods(job, engine):
    own = load_campaign(JOBS / f"{job}.yaml").scene
    published = as_published(own)
    assert published.engine.model_dump() == pytest.approx(engine)
    assert published.solver.model_dump() == {"law": "iteration", "tolerance": 1e-6, "cap": 100}
    assert published.cooling.model_dump() == own.cooling.model_dump() | {"integration": "euler"}
    others = own.model_fields.keys() - METHOD
    assert all(getattr(published, name) == getattr(own, name) for name in others)


def test_the_published_method_is_a_legal_scene():
    published = as_published(load_campaign(JOBS / "agglomeration_2004.yaml").scene)
    assert (
        SceneSection.checked({key: value for key, value in published if value is not None})
        == published
    )


def test_what_a_scene_does_not_solve_has_no_published_method():
    own = scene(restitution={"law": "constant", "value": 0.9}, duration="mean_speed")
    published = as_published(own)
    assert (published.solver, published.cooling) == (own.solver, own.cooling)
    assert published.engine.model_dump() == {"law": "adaptive", "floor": 1e-4, "ceiling": 0.1}


def test_a_time_that_depends_on_the_string_gets_the_printed_steps():
    engine = as_published(scene(end_time="characteristic")).engine
    assert engine.model_dump() == {"law": "adaptive", "floor": 1e-6, "ceiling": 1e-3}


@pytest.fixture(scope="module")
def campaign():
    return load_campaign("jobs/accuracy/accretion_2003_row_1.yaml")


def studied(campaign, quick=False):
    return StudiedScene(campaign, campaign.parameters(), 5, 9, quick)


def test_the_published_method_is_run_where_the_scene_differs_from_it(campaign):
    setups = published_setups(studied(campaign))
    assert list(setups) == [ITERATION, WHOLE]
    assert published_setups(studied(campaign, quick=True)) == {}
    iterated, whole = setups.values()
    assert iterated.campaign.scene.solver.law == "iteration"
    assert iterated.engine.law == "event"
    assert whole.campaign.scene == as_published(campaign.scene)
    published = with_scene(campaign, **dict(as_published(campaign.scene)))
    assert published_setups(studied(published)) == {}


def test_the_bias_of_the_published_method_is_over_growth(campaign):
    shared = 2.0 + 0.1 * np.random.default_rng(1).normal(size=50)
    part = steps_part(studied(campaign))
    samples = {name: made_up(shared) for name in part.setups} | {
        ITERATION: made_up(shared - 0.1, collisions=10, capped_iterations=4),
        WHOLE: made_up(shared, failed=[0], collisions=10),
    }
    found = part.section(samples)
    growth = shared.mean()
    iterated, _ = found.conclusions[-2:]
    assert iterated.startswith("Published impact iteration, exact times: mean b/b⁰ is")
    assert f"{-10.0 / growth:+.2f} ± 0.00 %" in iterated
    assert "published" not in found.conclusions[0]
    frame = frame_of(found.tables[0])
    assert frame["method"][frame[STEP].isna()].tolist() == [ITERATION, WHOLE]
    assert any("40 % of all impacts end at the iteration's cap" in text for text in found.failures)
    assert any("1 of 50 samples failed" in text for text in found.failures)


def section_of(scenes, samples):
    return extremes_part(scenes, 4).section(samples)


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
        published_name("calm"): made_up([1.5] * 8, **sound),
        published_name("wild"): broken,
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
    names = [published_name(name) for name in ("same", "more", "solid")]
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
    found = section_of({"calm": campaign}, {"calm": rows, published_name("calm"): rows})
    assert "4 of 4 samples failed (budget of steps or events exceeded)" in found.failures[0]
    assert all(found.tables[0].cells[0])
