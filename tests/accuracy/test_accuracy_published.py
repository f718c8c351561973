"""The published method is another method for the same physics."""

from pathlib import Path

import pytest

from agglom_mpi import load_campaign
from agglom_mpi.accuracy.published import as_published
from agglom_mpi.config.scene import SceneSection

JOBS = Path(__file__).parents[2] / "jobs"
METHOD = {"engine", "solver", "cooling"}


def scene(**entries):
    box = {"particles": 10, "half_width": 0.01, "velocities": "uniform_x", "end_time": 1.0}
    return SceneSection.model_validate(box | entries)


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
    others = own.model_dump().keys() - METHOD
    assert published.model_dump(include=others) == own.model_dump(include=others)


def test_the_published_method_is_a_legal_scene():
    own = load_campaign(JOBS / "agglomeration_2004.yaml").scene
    assert SceneSection.model_validate(as_published(own).model_dump()) == as_published(own)


def test_what_a_scene_does_not_solve_has_no_published_method():
    own = scene(restitution={"law": "constant", "value": 0.9}, duration="mean_speed")
    published = as_published(own)
    assert (published.solver, published.cooling) == (own.solver, own.cooling)
    assert published.engine.model_dump() == {"law": "adaptive", "floor": 1e-4, "ceiling": 0.1}


def test_a_time_that_depends_on_the_string_gets_the_printed_steps():
    engine = as_published(scene(end_time="characteristic")).engine
    assert engine.model_dump() == {"law": "adaptive", "floor": 1e-6, "ceiling": 1e-3}
