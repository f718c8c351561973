"""Count samples of scenes at all extremes at once: nothing hangs, overflows or is lost.

`AGGLOM_EXTREMES_EXAMPLES` sets how many scenes of the event engine's most general kind are drawn;
of the other kinds a share of that. `--hypothesis-show-statistics` says what became of them.
"""

import os

import pytest
from extreme_checks import assert_sound, fingerprint
from extreme_scenes import (
    adaptive_steps,
    aggregating,
    bouncing,
    equal_steps,
    events,
)
from extreme_states import arranged
from hypothesis import HealthCheck, event, given, settings
from hypothesis import strategies as st
from plain_python import PLAIN

from agglom_mpi.outcome import COMPLETED, FAILED, FailureReason
from agglom_mpi.random_streams import sample_stream
from agglom_mpi.simulation.sample import simulate_scene

EXAMPLES = int(os.environ.get("AGGLOM_EXTREMES_EXAMPLES", "120"))


def some(share):
    return settings(
        max_examples=max(10, int(EXAMPLES * share)),
        deadline=None,
        derandomize=True,
        suppress_health_check=list(HealthCheck),
    )


SHORT = 25 / 120
BUDGET = 20_000
PERIODIC = aggregating("periodic", "compression_recovery", "constant", events(BUDGET))
"""Of the type of `jobs/agglomeration_2004.yaml`."""
REENTRY = aggregating("reentry", "mean_speed", "restitution_scaled", events(BUDGET))
CONSTANT = bouncing("periodic", False, events(2000))
LASTING = bouncing("reentry", True, events(BUDGET))
FIXED = aggregating(
    "periodic", "mean_speed", "restitution_scaled", equal_steps, integration="euler"
)
ADAPTIVE = aggregating("reentry", "compression_recovery", "constant", adaptive_steps)
OWN = aggregating(
    "reentry", "compression_recovery", "constant", adaptive_steps, own=True, integration="euler"
)


def simulated(drawn, key=None):
    """Return a drawn scene, its start, and the sample that a campaign would make of it.

    The random stream is that of the parameters `key` where these are given.
    """
    campaign = drawn.campaign()
    parameters = campaign.parameters()
    scene = campaign.scene.build(parameters)
    key = parameters if key is None else key
    stream = [sample_stream(campaign.seed, key, drawn.sample) for _ in range(2)]
    at_once, before = simulate_scene(scene._replace(end_time=0.0), stream[0])
    assert at_once["state"] == COMPLETED
    assert at_once["collisions"] == 0
    assert abs(at_once["energy_error"]) <= 1e-9
    return scene, before, *simulate_scene(scene, stream[1])


def tell(record):
    """Report what became of a scene."""
    if record["state"] == FAILED:
        event("failed")
        return
    digits = len(str(record["collisions"])) if record["collisions"] else 0
    event(f"collisions: {digits} digits")
    for what in ("merges", "breakups", "overlaps"):
        if record[what]:
            event(what)
    if record["particles"] == 1:
        event("all merged")


@pytest.mark.parametrize("share", [SHORT, pytest.param(1, marks=pytest.mark.slow)])
def test_the_event_engine_in_a_periodic_box(share):
    @some(share)
    @given(PERIODIC)
    def periodic(drawn):
        scene, before, record, particles = simulated(drawn)
        tell(record)
        assert_sound(scene, before, record, particles)

    periodic()


@pytest.mark.slow
@some(0.3)
@given(REENTRY)
def test_the_event_engine_with_reentry(drawn):
    scene, before, record, particles = simulated(drawn)
    tell(record)
    assert_sound(scene, before, record, particles)


@pytest.mark.slow
@some(0.3)
@given(CONSTANT)
def test_constant_restitution(drawn):
    """What loses a share at each impact may collide without end; that is no number of events."""
    scene, before, record, particles = simulated(drawn)
    tell(record)
    if record["state"] == FAILED:
        assert record["reason"] == FailureReason.BUDGET_EXCEEDED
        assert 0.0 < drawn.scene["restitution"]["value"] < 1.0
        return
    assert_sound(scene, before, record, particles)


@pytest.mark.slow
@some(0.3)
@given(LASTING)
def test_constant_restitution_with_a_contact_time(drawn):
    scene, before, record, particles = simulated(drawn)
    tell(record)
    assert_sound(scene, before, record, particles)


@pytest.mark.slow
@pytest.mark.parametrize("kind", [FIXED, ADAPTIVE, OWN], ids=["fixed", "adaptive", "own energy"])
def test_steppers(kind):
    @some(0.3)
    @given(kind)
    def stepper(drawn):
        scene, before, record, particles = simulated(drawn)
        tell(record)
        assert_sound(scene, before, record, particles)

    stepper()


@pytest.mark.parametrize(
    ("share", "most"),
    [pytest.param(SHORT, 8, marks=PLAIN), pytest.param(0.3, 24, marks=pytest.mark.slow)],
)
def test_any_state_in_a_periodic_box(share, most):
    """Chains and lattices of touching spheres, coinciding ones, mass ratios to 1e9."""

    @some(share)
    @given(arranged(PERIODIC, True, most))
    def any_state(state):
        record, particles, ledger = state.carried()
        tell(record)
        assert_sound(state.scene, state.particles(), record, particles, ledger)

    any_state()


@pytest.mark.slow
@some(0.3)
@given(arranged(LASTING, periodic=False))
def test_any_state_of_constant_restitution_with_reentry(state):
    record, particles, ledger = state.carried()
    tell(record)
    law = state.scene.laws.restitution
    if record["state"] == FAILED:
        assert record["reason"] == FailureReason.BUDGET_EXCEEDED
        assert law.value < 1.0
        assert law.contact_time == 0.0
        return
    assert_sound(state.scene, state.particles(), record, particles, ledger)


LENGTHS = st.sampled_from([-40, -9, -1, 0, 2, 33])
TIMES = st.sampled_from([-31, -4, 0, 1, 20])
LESS = st.sampled_from([-7, 0])


@pytest.mark.parametrize(
    ("kind", "share"),
    [
        pytest.param(PERIODIC, SHORT, id="periodic, short"),
        *(
            pytest.param(kind, 0.3, id=name, marks=pytest.mark.slow)
            for name, kind in {
                "periodic": PERIODIC,
                "reentry": REENTRY,
                "constant": CONSTANT,
                "lasting": LASTING,
                "fixed": FIXED,
                "adaptive": ADAPTIVE,
                "own energy": OWN,
            }.items()
        ),
    ],
)
def test_units_of_length_mass_and_time_do_not_change_a_bit(kind, share):
    @some(share)
    @given(kind, LENGTHS, TIMES, LESS)
    def units(drawn, length, time, less):
        # The emissivity scales as mass over time cubed, and may not exceed 1.
        other = drawn.in_units(2.0**length, 2.0 ** (3 * time + less), 2.0**time)
        key = drawn.campaign().parameters()
        first, again = simulated(drawn), simulated(other, key)
        assert fingerprint(again[0], *again[2:]) == fingerprint(first[0], *first[2:])

    units()
