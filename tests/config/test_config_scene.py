"""What kernels see of a campaign: the typed scene, where the campaign file leaves a choice."""

import pytest
from campaign_text import campaign, constant

from agglom_mpi.config.campaign import Campaign
from agglom_mpi.physics.cooling import EulerCooling, ExactCooling, QuarticCooling, RadiativeCooling
from agglom_mpi.physics.restitution import (
    ConstantRestitution,
    LastingContact,
    PressureRestitution,
)
from agglom_mpi.simulation.engines import AdaptiveSteps, EventDriven, FixedSteps
from agglom_mpi.simulation.scene import Scene


def built(loaded: Campaign, engine: str | None = None) -> Scene:
    return loaded.scene.build(loaded.parameters(), loaded.engine(engine))


def test_the_scene_has_the_engine_of_the_campaign_or_another() -> None:
    own = campaign(("  engine", "  engine: {law: event, budget: 7}"))
    assert built(own).engine == EventDriven.Numbers(7)
    assert built(own, "fixed:20").engine == FixedSteps.Numbers(20)
    assert built(own, "adaptive").engine == AdaptiveSteps.Numbers(1e-6, 1e-3)
    assert built(campaign(), "event").engine == EventDriven.Numbers(20_000)
    assert own.scene.build(own.parameters()).engine == EventDriven.Numbers(7)


LAWS = {
    "quartic": QuarticCooling,
    "radiation, emissivity: 0.5, surroundings: 300 K": RadiativeCooling,
}


@pytest.mark.parametrize("law", LAWS)
def test_steppers_cool_as_the_campaign_says_and_the_event_engine_exactly(law: str) -> None:
    euler = campaign(("  cooling", f"  cooling: {{law: {law}, integration: euler}}"))
    exact = campaign(("  cooling", f"  cooling: {{law: {law}}}"), ("  engine", "  engine: event"))
    wanted = {
        (euler, None): EulerCooling,
        (euler, "fixed:10"): EulerCooling,
        (euler, "adaptive"): EulerCooling,
        (euler, "event"): ExactCooling,
        (exact, None): ExactCooling,
        (exact, "event"): ExactCooling,
        (exact, "fixed"): ExactCooling,
        (exact, "adaptive"): ExactCooling,
    }
    for (loaded, engine), integration in wanted.items():
        cooling = built(loaded, engine).cooling
        assert type(cooling) is integration
        assert type(cooling.law) is LAWS[law].Numbers


def test_without_cooling_no_engine_cools() -> None:
    for engine in ("event", "fixed", "adaptive"):
        assert built(campaign(), engine).cooling is None


def test_restitution_has_a_contact_time_only_where_the_campaign_gives_one() -> None:
    wanted = {
        campaign(): PressureRestitution.Numbers(),
        constant(): ConstantRestitution.Numbers(0.9),
        constant("0 s"): ConstantRestitution.Numbers(0.9),
        constant(value=0): ConstantRestitution.Numbers(0.0),
        constant("0", value=0): ConstantRestitution.Numbers(0.0),
        constant("2 us"): LastingContact.Numbers(0.9, 2e-6),
        constant("2 us", value=1): LastingContact.Numbers(1.0, 2e-6),
    }
    for loaded, restitution in wanted.items():
        found = built(loaded).laws.restitution
        assert type(found) is type(restitution)
        assert found == restitution
