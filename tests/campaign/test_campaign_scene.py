"""What kernels see of a campaign: the typed scene, where the campaign file leaves a choice."""

from campaign_text import campaign

from agglom_mpi.campaign import Campaign
from agglom_mpi.simulation.scene import AdaptiveSteps, EventDriven, FixedSteps, Scene, build_scene


def built(loaded: Campaign, engine: str | None = None) -> Scene:
    return build_scene(loaded.scene, loaded.parameters(), loaded.engine(engine))


def test_the_scene_has_the_engine_of_the_campaign_or_another() -> None:
    own = campaign(("  engine", "  engine: {law: event, budget: 7}"))
    assert built(own).engine == EventDriven(7)
    assert built(own, "fixed:20").engine == FixedSteps(20)
    assert built(own, "adaptive").engine == AdaptiveSteps(1e-6, 1e-3)
    assert built(campaign(), "event").engine == EventDriven(20_000)
    assert build_scene(own.scene, own.parameters()).engine == EventDriven(7)
