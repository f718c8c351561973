"""Samples of a string simulated again to count their collisions by mass and time."""

import math
import os
from collections.abc import Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import Final

import numpy as np
import numpy.typing as npt

from agglom_mpi.analysis.collision_kernels import (
    BLOCKS,
    CollisionKernels,
    add_sample,
    new_sums,
)
from agglom_mpi.analysis.merged_pairs import LEAST_BLOCKS
from agglom_mpi.config.campaign import Campaign
from agglom_mpi.config.given_strings import read_string
from agglom_mpi.config.yaml_source import ArgumentError
from agglom_mpi.errors import FAILURE, UserError
from agglom_mpi.outcome import REASONS
from agglom_mpi.simulation.boundary import is_sheared
from agglom_mpi.simulation.collision_counts import CollisionCounts, new_collision_counts
from agglom_mpi.simulation.compilation import ensure_counting_compiled
from agglom_mpi.simulation.sample import count_collisions
from agglom_mpi.simulation.scene import Scene
from agglom_mpi.verbs.simulate import random_numbers

DECADES_BELOW: Final = 2
"""Decades of mass below a mean grain that have bins, where grains differ in size or break."""


class CountingError(UserError, RuntimeError):
    """Samples failed, and too few are left."""

    exit_code = FAILURE


def collision_kernels(
    campaign: Campaign,
    parameters: Mapping[str, float | str] | npt.ArrayLike,
    samples: int = 200,
    bins: int = 12,
    times: Sequence[float] = (),
    first_sample: int = 0,
) -> CollisionKernels:
    """Count the collisions of samples of a string; see `RunnableCampaign.collision_kernels`."""
    campaign.require_one_scene("collision_kernels")
    vector = read_string(campaign, parameters)
    count = campaign.count("samples", samples, least=LEAST_BLOCKS)
    per_decade = campaign.count("bins", bins, least=1)
    first = campaign.count("first_sample", first_sample)
    campaign.check_scales(vector)
    scene = campaign.at(vector).build(campaign.engine("event"))
    if is_sheared(scene.escape):
        message = "is shear; collisions are counted in a box at rest"
        raise ArgumentError.of(campaign.name, "scene.escape", message)
    ends = _windows(campaign, scene, times)
    counts = _new_counts(scene, per_decade, ends)
    ensure_counting_compiled(scene)
    sums = new_sums(counts, min(BLOCKS, count))
    blocks = len(sums.samples)
    abort = np.zeros(1, np.uint8)

    def simulate_block(block: int) -> list[str]:
        failures = []
        for sample in range(first + block, first + count, blocks):
            found = _new_counts(scene, per_decade, ends)
            random = random_numbers(campaign, vector, sample)
            reason = count_collisions(scene, random, found, abort)
            if abort[0]:
                break
            if reason is None:
                add_sample(sums, block, found)
            else:
                failures.append(f"sample {sample} failed: {REASONS[reason]}")
        return failures

    pool = ThreadPoolExecutor(len(os.sched_getaffinity(0)), "samples")
    try:
        futures = [pool.submit(simulate_block, block) for block in range(blocks)]
        failures = [each for future in futures for each in future.result()]
    finally:
        abort[0] = 1
        pool.shutdown(cancel_futures=True)
    if np.count_nonzero(sums.samples) < LEAST_BLOCKS:
        raise CountingError(failures[0] if failures else "too few samples for standard errors")
    middle, _ = counts.grid
    masses = middle * 10.0 ** (np.arange(len(counts.present)) / per_decade)
    density = scene.mass / (4.0 / 3.0 * math.pi * scene.radius**3)
    volume = (2.0 * scene.half_width) ** 3
    box = volume, density, scene.mass
    found = sums, masses, np.array([0.0, *ends]), *box, len(failures)
    table = campaign.variables
    values = {
        each.name: (float(vector[table.index(each.name)]), each.unit)
        for each in table.variables
        if each.name in table.used
    }
    return CollisionKernels(*found, campaign.impact_tests_at(vector), parameters=values)


def _windows(campaign: Campaign, scene: Scene, times: Sequence[float]) -> npt.NDArray[np.float64]:
    """Return the ends of the windows in s, the last one that of the scene."""
    try:
        ends = np.array([*times, scene.end_time], np.float64)
    except (TypeError, ValueError):
        ends = np.zeros(1)
    if not (np.all(np.diff(ends) > 0.0) and ends[0] > 0.0):
        message = f"are {list(times)!r} s; must ascend between 0 and {scene.end_time:g} s"
        raise ArgumentError.of(campaign.name, "times", message)
    return ends


def _new_counts(scene: Scene, per_decade: int, ends: npt.NDArray[np.float64]) -> CollisionCounts:
    """Return room for the collisions of a sample: bins up to the mass of all grains together."""
    below = 0 if scene.sizes is None and scene.laws.fragmentation is None else DECADES_BELOW
    above = math.ceil(per_decade * math.log10(scene.particles))
    lowest = scene.mass / 10.0**below
    return new_collision_counts(lowest, per_decade, below * per_decade + above + 1, ends)
