"""Ten million elastic collisions: how long they take, and how well they keep the kinetic energy.

Run with `pytest tests/benchmarks/bench_elastic.py -m benchmark -s`.
"""

from dataclasses import replace
from pathlib import Path

import pytest

from agglom_mpi import load_campaign
from agglom_mpi.simulation.engines import EventDriven
from agglom_mpi.verbs.simulate import simulate

SCENE = Path(__file__).parents[2] / "jobs" / "extremes" / "elastic.yaml"


@pytest.mark.benchmark
def test_ten_million_elastic_collisions_keep_the_kinetic_energy():
    campaign = load_campaign(SCENE)
    longer = {"end_time": 10.5 * campaign.scene.end_time, "engine": EventDriven(budget=10**7)}
    longer = replace(campaign, scene=campaign.scene.model_copy(update=longer))
    outcome = simulate(longer, {})
    error, drift = outcome.ledger["energy_error"], outcome.ledger["momentum_error"]
    print(f"\n{outcome.collisions:,} collisions in {outcome.seconds:.2f} s")
    print(f"kinetic energy changed by {error:.1e}, momentum by {drift:.1e} of the sum of m|v|")
    assert outcome.collisions > 10**7
    assert abs(error) <= 1e-10
    assert drift <= 1e-12
