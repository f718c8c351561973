"""The published strings whose accuracy is reported."""

import pytest

from agglom_mpi.config.loading import load_campaign


@pytest.mark.parametrize("job", ["accretion_2003", "agglomeration_2004"])
def test_a_published_string_is_in_the_scene_of_its_job(job):
    alone, searched = (
        load_campaign(f"jobs/{name}.yaml") for name in (f"accuracy/{job}_row_1", job)
    )
    assert alone.scene == searched.scene
    assert alone.objective == searched.objective
    assert alone.seed == searched.seed
    values = alone.parameters()
    inside = (searched.variables.lower <= values) & (values <= searched.variables.upper)
    assert inside[: len(searched.variables.used)].all()
