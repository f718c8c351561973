"""The published method is another method for the same physics; its bias, on made-up samples."""

from pathlib import Path

import numpy as np
import pytest
from accuracy_rows import frame_of, made_up

from agglom_mpi.accuracy.study import with_scene
from agglom_mpi.accuracy.time_integration.published_method import as_published
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
