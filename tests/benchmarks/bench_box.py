"""What stepping a box from outside costs: per call, and many short steps against one long one.

Run with `pytest tests/benchmarks/bench_box.py -m benchmark -s`, or as a program.
"""

import statistics
import time

import numpy as np
import pytest

from agglom_mpi import Box
from agglom_mpi.config.campaign import Campaign
from agglom_mpi.simulation.sample import simulate_scene

COUNTS = (100, 1000, 10_000)
STEPS = (1, 10, 100, 1000)
REPEATS = 7
COLLISIONS = 10
"""Collisions per particle, nearly."""

SCENE = """
seed: 1
scene:
  particles: {count}
  half_width: 1 cm
  velocities: {{law: spread, mean: [0, 0, 0], transverse: 1}}
  restitution: {{law: constant, value: 0.8}}
  heating: none
  end_time: {end}
variables: {{relative_speed: 1, size_ratio: 0.5, density: 2500}}
"""


def campaign_of(count):
    """Return a gas, to be run for the same number of collisions per particle."""
    end = COLLISIONS / 356.0 * (200.0 / count) ** (1.0 / 3.0)
    return Campaign.from_text(SCENE.format(count=count, end=end)), end


def seconds_of(call):
    begin = time.process_time()
    call()
    return time.process_time() - begin


def run_in(box, end, steps):
    box.reset()
    return seconds_of(lambda: [box.advance(end / steps) for _ in range(steps)])


def measure(count):
    """Medians in s of processor time: the bare kernel, the box in so many steps, an empty step."""
    campaign, end = campaign_of(count)
    scene, box = campaign.scene.build(campaign.parameters()), Box(campaign)
    box.advance(end)
    simulate_scene(scene, np.random.default_rng(1))
    rows = {"kernel": [], "placement": [], "empty": [], **{steps: [] for steps in STEPS}}
    for repeat in range(REPEATS):
        random = np.random.default_rng(repeat)
        rows["kernel"].append(seconds_of(lambda: simulate_scene(scene, random)))  # noqa: B023
        nothing = scene._replace(end_time=0.0)
        rows["placement"].append(seconds_of(lambda: simulate_scene(nothing, random)))  # noqa: B023
        for steps in STEPS:
            rows[steps].append(run_in(box, end, steps))
        rows["empty"].append(run_in(box, 1e-12, 100) / 100)
    return {name: statistics.median(values) for name, values in rows.items()}


@pytest.mark.benchmark
@pytest.mark.parametrize("count", COUNTS)
def test_steps_of_a_box(count):
    found = measure(count)
    alone = found["kernel"] - found["placement"]
    print(f"\n{count} particles, {COLLISIONS} collisions each; medians of {REPEATS}")
    print(f"  the kernel alone, without placement   {1e3 * alone:9.3f} ms")
    for steps in STEPS:
        ratio, one = found[steps] / alone, found[steps] / found[1]
        seconds = 1e3 * found[steps]
        print(f"  {steps:4d} steps  {seconds:9.3f} ms, kernel × {ratio:.2f}, one step × {one:.2f}")
    print(f"  one step in which nothing happens     {1e6 * found['empty']:9.1f} µs")


if __name__ == "__main__":
    for number in COUNTS:
        test_steps_of_a_box(number)
