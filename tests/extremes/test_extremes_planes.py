"""The default method is sound in the planes of the stability maps, wherever one looks."""

import os

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from agglom_mpi.accuracy.maps.planes import DEFAULT, PLANES
from agglom_mpi.accuracy.maps.scene import map_scene
from agglom_mpi.accuracy.soundness import CLOSED, overlaps_part
from agglom_mpi.config.loading import load_campaign
from agglom_mpi.outcome import REASONS, FailureReason
from agglom_mpi.verbs.simulate import simulate
from agglom_mpi.verbs.simulate_many import simulate_many

EXAMPLES = max(1, int(os.environ.get("AGGLOM_EXTREMES_EXAMPLES", "300")) // 40)
SHARE = st.integers(0, 1024).map(lambda k: k / 1024.0)
JOBS = {
    "A": "jobs/accuracy/accretion_2003_row_1.yaml",
    "B": "jobs/accuracy/agglomeration_2004_row_1.yaml",
}


def assert_sound_at(scene, plane, across, up, sample):
    """Simulate one sample of the default method, and of its remedy where it exhausts its budget."""
    x, y = plane.x.value(across), plane.y.value(up)
    if plane.refusal_excuse(x, y) or (plane.name == "masses" and across == 0.0):
        return
    methods = dict(plane.methods(plane.campaign(scene, x, y), y, True))
    campaign = methods[DEFAULT]
    if plane.remedy:
        assert_ledger_closes(methods[plane.remedy], sample)
        found = simulate_many(campaign, campaign.parameters(), first_sample=sample)
        if found.failed.any():
            assert found.reasons == {(0, 0): REASONS[FailureReason.BUDGET_EXCEEDED]}
            return
    assert_ledger_closes(campaign, sample)


def assert_ledger_closes(campaign, sample):
    record = simulate(campaign, campaign.parameters(), sample).record
    assert abs(record["energy_error"]) <= CLOSED
    assert record["capped_iterations"] == 0
    assert record["floored_temperatures"] == 0
    if record["breakups"] == 0 and record["overlaps"] > 0:
        assert overlaps_part(campaign, [sample])


@pytest.mark.slow
@pytest.mark.parametrize("job", JOBS.values(), ids=JOBS)
@pytest.mark.parametrize("name", PLANES)
def test_the_default_method_is_sound_everywhere_in_a_plane(job, name):
    scene = map_scene(load_campaign(job), {}, 40, 5000)

    @settings(
        max_examples=EXAMPLES,
        deadline=None,
        derandomize=True,
        suppress_health_check=list(HealthCheck),
    )
    @given(SHARE, SHARE, st.integers(0, 9))
    def anywhere(across, up, sample):
        assert_sound_at(scene, PLANES[name], across, up, sample)

    anywhere()
