"""Speed of a sample with each law of restitution beside that of the papers, in the same gas.

Run with `pytest tests/benchmarks/bench_laws.py -m benchmark -s` (some minutes, half of them
compiling). Processor time of one thread, placement and measuring included; samples take turns, and
each number is a median. Grains of glass, 100 µm across, meet at 10 m/s, where next to none stick:
what differs is the law and how many collisions it leaves.
"""

import math
import statistics

import pytest
from bench_event import print_row

from agglom_mpi.config.loading import load_campaign
from agglom_mpi.verbs.simulate import simulate

REPEATS = 31
WIDTHS = (24, 12, 14, 24)
GLASS = "youngs_modulus: 70 GPa, poisson_ratio: 0.2"
DRY = f"{{law: viscoelastic, {GLASS}, dissipative_constant: 10 ns}}"
LIQUID = "viscosity: 1 mPa*s, film_thickness: 10 nm, roughness: 5 nm"
GAS = """
title: a gas of glass beads
seed: 1
scene:
  particles: 1000
  grain_diameter: 100 um
  velocities: {{law: spread, mean: [0, 0, 0], transverse: 1}}
  restitution: {restitution}
  heating: none
  end_time: 300 us
  {others}
variables: {{relative_speed: 10, volume_fraction: 0.2, density: 2500, friction: 0{more}}}
"""
PRESSURE = """duration: {law: mean_speed, length_ratio: 1e-6}
  contact_area: {initial: 0.01, final: 1}
  hardness: constant"""
LAWS = {
    "pressure [A 6]": ("pressure", PRESSURE, ", hardness: 1e12"),
    "constant": ("{law: constant, value: 0.9}", "", ""),
    "viscoelastic": (DRY, "", ""),
    "viscoelastic_measured": (
        "{law: viscoelastic_measured, restitution: 0.9, speed: 1, radius: 50 um}",
        "",
        "",
    ),
    "elastic_plastic": (f"{{law: elastic_plastic, {GLASS}, yield_pressure: 5 GPa}}", "", ""),
    "adhesive": (f"{{law: adhesive, {GLASS}, dry: {DRY}}}", "", ", surface_energy: 0.1"),
    "wet": (f"{{law: wet, {LIQUID}, dry: {DRY}}}", "", ""),
}
"""Each law, what else its scene needs, and further variables."""


def campaign_of(folder, restitution, others, more):
    path = folder / "gas.yaml"
    path.write_text(GAS.format(restitution=restitution, others=others, more=more))
    return load_campaign(path)


@pytest.mark.benchmark
def test_print_what_a_sample_costs_with_each_law(tmp_path):
    campaigns = {name: campaign_of(tmp_path, *parts) for name, parts in LAWS.items()}
    for campaign in campaigns.values():
        simulate(campaign, {}, 0)  # compiles
    rounds = [
        {name: simulate(campaign, {}, 1 + turn) for name, campaign in campaigns.items()}
        for turn in range(REPEATS)
    ]
    print(f"\n1000 grains, volume fraction 0.2, event engine; {REPEATS} samples of each, in turns")
    print_row(WIDTHS, ("law", "ms/sample", "collisions", "ns/collision, ratio"))
    costs = {
        name: [1e9 * turn[name].cpu_seconds / turn[name].collisions for turn in rounds]
        for name in LAWS
    }
    papers = costs["pressure [A 6]"]
    for name, cost in costs.items():
        ratios = [each / peer for each, peer in zip(cost, papers, strict=True)]
        middle = statistics.median(ratios)
        spread = 1.4826 * statistics.median(abs(each - middle) for each in ratios)
        error = 1.2533 * spread / math.sqrt(REPEATS)  # of a median
        milliseconds = statistics.median(1e3 * turn[name].cpu_seconds for turn in rounds)
        collisions = statistics.mean(turn[name].collisions for turn in rounds)
        ratio = f"{middle:.3f} ± {error:.3f}"
        each = f"{statistics.median(cost):.0f}, {ratio}"
        print_row(WIDTHS, (name, f"{milliseconds:.2f}", f"{collisions:.0f}", each))
        assert all(turn[name].particles > 950 for turn in rounds)
