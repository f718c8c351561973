"""How many samples searches need, over seeds: what they find is estimated again on fresh samples.

`pytest tests/benchmarks/bench_search.py -m benchmark -s` takes some hours of two cores;
`python tests/benchmarks/bench_search.py SEEDS SAMPLES [NAME ...]` does less of it, and with the
name `doubling` the 2003 paper's question alone.
"""

import re
import sys
from concurrent.futures import ProcessPoolExecutor
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from agglom_mpi.config.campaign import Campaign
from agglom_mpi.outcome import summaries
from agglom_mpi.random_streams import sample_stream
from agglom_mpi.runtime.experiment import InversionExperiment
from agglom_mpi.search.ensemble import Ensemble
from agglom_mpi.search.proposals import GenerationSummary
from agglom_mpi.search.space import SearchSpace
from agglom_mpi.simulation.sample import simulate_scene

JOBS = Path(__file__).parents[2] / "jobs"
JOB, DOUBLING = JOBS / "agglomeration_2004.yaml", JOBS / "accretion_2003.yaml"
SEEDS, SAMPLES = 10, 4200
LEVELS = (0.677, 0.64, 0.61)
FRESH = 10**6
"""Number of the first sample that no search has seen."""
AGAIN, FINAL = 64, 300
"""Fresh samples of each string that was ever the best, and of the last one."""
DOUBLING_SAMPLES, FINALISTS, FINALIST, DOUBLING_FINAL = 400, 12, 500, 4000
"""Samples of a search for strings that double the size, strings that it ends with, fresh samples
of each of those, and others of the best of them."""

PUBLISHED = "rule: successive_difference, quantity: objective, tolerance: 5e-4, max_samples: 200"
NARROW = "rule: standard_error, tolerance: 0.02, max_samples: 200"
SEARCHES = {
    "genetic, published rule": ("population: 20, parents: 6", PUBLISHED),
    "genetic, box rescaled, published rule": (
        "population: 20, parents: 6, rescale: {every: 4, factor: 0.5}",
        PUBLISHED,
    ),
    "genetic, mutation, published rule": (
        "population: 20, parents: 6, blend: [-0.5, 1.5]",
        PUBLISHED,
    ),
    "genetic, half-width 0.02": ("population: 20, parents: 6", NARROW),
    "genetic, half-width 0.02, racing": (
        "population: 20, parents: 6",
        f"{NARROW}, racing: {{confidence: 0.9}}",
    ),
    "genetic, 1 sample": ("population: 20, parents: 6", "rule: fixed, samples: 1"),
    "genetic, 3 samples": ("population: 20, parents: 6", "rule: fixed, samples: 3"),
    "cmaes, 1 sample": ("method: cmaes, population: 20", "rule: fixed, samples: 1"),
    "cmaes, 3 samples": ("method: cmaes, population: 20", "rule: fixed, samples: 3"),
    "surrogate, 1 sample": ("method: surrogate", "rule: fixed, samples: 1"),
    "surrogate, 3 samples": ("method: surrogate", "rule: fixed, samples: 3"),
    "random, published rule": ("method: random", PUBLISHED),
    "sobol, published rule": ("method: sobol", PUBLISHED),
    "pymoo's GA, published rule": ("population: 20, parents: 6", PUBLISHED),
    "pymoo's GA, 1 sample": ("population: 20, parents: 6", "rule: fixed, samples: 1"),
}
COMMON = ("genetic, 1 sample", "genetic, 3 samples", "surrogate, 1 sample", "surrogate, 3 samples")
SEARCHES |= {
    f"{name}, common": (SEARCHES[name][0], f"{SEARCHES[name][1]}, common_configurations: true")
    for name in COMMON
}


@cache
def campaign(name, seed, job=JOB):
    """Return the job with another search, ensemble and seed."""
    search, ensemble = SEARCHES[name]
    text = re.sub(r"(?m)^seed: .*$", f"seed: {seed}", job.read_text())
    head = text[: text.index("search:")]
    plan = f"search: {{{search}}}\nensemble: {{{ensemble}}}\nstopping: {{generations: 5000}}\n"
    return Campaign.from_text(head + plan)


def simulate(of, parameters, sample):
    random = sample_stream(of.seed, parameters, sample, of.common_configurations)
    record, _ = simulate_scene(of.scene.build(parameters, None), random)
    rows = np.zeros(1, record.dtype)
    rows[0] = record
    return rows


def estimate(of, parameters, samples):
    """Objective of a string on fresh samples, and its standard error."""
    rows = np.concatenate([simulate(of, parameters, FRESH + i) for i in range(samples)])
    return of.objective.of_rows(rows)


class Best:
    """Which strings were the best after each generation, and after how many samples."""

    def __init__(self):
        self.best = []

    def record(self, decisions):
        for decision in decisions:
            if isinstance(decision, GenerationSummary):
                self.best.append((decision.samples_used, decision.population[:FINALISTS]))


def searched(name, seed, samples, job=JOB):
    """Search with so many samples; yields samples used and the best strings after generations."""
    yield from generations_of(campaign(name, seed, job), samples)


def generations_of(of, samples):
    """Run a campaign for so many samples; yields what `searched` does."""
    history = Best()
    inversion = InversionExperiment(of).inversion(None)
    history.record(inversion.start())
    used, told = 0, 0
    while used < samples:
        for string, progress in inversion.open_strings.items():
            if inversion.progress(string) is None:
                continue  # out of the race
            rows = simulate(of, inversion.parameters(string), progress.next_sample)
            history.record(inversion.complete(string, progress.next_sample, rows))
            used += 1
            if len(history.best) > told or used >= samples:
                break
        for at, best in history.best[told:]:
            yield at, [inversion.parameters(int(string)) for string in best]
        told = len(history.best)


def searched_by_pymoo(name, seed, samples):
    from pymoo.algorithms.soo.nonconvex.ga import GA
    from pymoo.core.evaluator import Evaluator
    from pymoo.core.problem import Problem
    from pymoo.core.termination import NoTermination
    from pymoo.problems.static import StaticProblem

    of = campaign(name, seed)
    space, ensemble = SearchSpace.of(of.variables), of.ensemble
    problem = Problem(n_var=space.dimensions, n_obj=1, xl=0.0, xu=1.0)
    algorithm = GA(pop_size=20)
    algorithm.setup(problem, termination=NoTermination(), seed=seed, verbose=False)
    objective = of.objective
    used = 0
    while used < samples:
        found = algorithm.ask()
        worth = []
        for parameters in space.from_unit(found.get("X")):
            judging = Ensemble(ensemble, objective, of.scene.particles)
            while not judging.finished:
                judging.add(summaries(simulate(of, parameters, judging.samples_used))[0])
            used += judging.samples_used
            worth.append(judging.result().objective)
        Evaluator().eval(StaticProblem(problem, F=np.array(worth)[:, None]), found)
        algorithm.tell(infills=found)
        yield used, space.from_unit(algorithm.opt.get("X"))


def measure(name, seed, samples):
    """Samples to each level, unbiased value at the end, and its error."""
    of, search = campaign(name, seed), searched_by_pymoo if "pymoo" in name else searched
    first, known, last = dict.fromkeys(LEVELS, np.inf), {}, None
    for used, (best, *_) in search(name, seed, samples):
        if used > samples:
            break
        last, key = best, best.tobytes()
        if key not in known:
            known[key], _ = estimate(of, best, AGAIN)
        for level in LEVELS:
            if known[key] <= level:
                first[level] = min(first[level], used)
    value, error = estimate(of, last, FINAL)
    return [first[level] for level in LEVELS], value, error


def deviation(seed):
    """Signed b^f/(2 b⁰) - 1 of the best finalist on samples of its own, and its standard error."""
    name = "surrogate, 1 sample"
    of = campaign(name, seed, DOUBLING)
    *_, (_, finalists) = searched(name, seed, DOUBLING_SAMPLES, DOUBLING)
    best = min(finalists, key=lambda string: estimate(of, string, FINALIST)[0])
    unseen = range(FRESH + FINALIST, FRESH + FINALIST + DOUBLING_FINAL)
    grown = np.array([simulate(of, best, i)["mean_radius_ratio"][0] / 2 - 1 for i in unseen])
    return grown.mean(), grown.std(ddof=1) / np.sqrt(DOUBLING_FINAL)


def doubling(seeds):
    print(f"\n2003 paper, {DOUBLING_SAMPLES} samples, then {FINALISTS} strings x {FINALIST} fresh:")
    print(f"b^f/(2 b0) - 1 of the best of these on {DOUBLING_FINAL} others")
    with ProcessPoolExecutor(2) as pool:
        values, errors = np.transpose(list(pool.map(deviation, range(seeds))))
    for value, error in zip(values, errors, strict=True):
        print(f"{value:8.4f} ± {error:.4f}")
    magnitudes = abs(values)
    print(f"magnitude: median {np.median(magnitudes):.4f}, highest {magnitudes.max():.4f}")


def table(seeds, samples, names=tuple(SEARCHES)):
    print(f"\nmedian (lowest, highest) of {seeds} seeds; {samples} samples each")
    print(f"{'samples until the best is worth':38s}", *(f"{level:>18}" for level in LEVELS), end="")
    print("   worth at the end, ± of one")
    with ProcessPoolExecutor(2) as pool:
        for name in names:
            runs = [pool.submit(measure, name, seed, samples) for seed in range(seeds)]
            reached, values, errors = zip(*(run.result() for run in runs), strict=True)
            print(f"{name:38s}", end="")
            for counts in np.array(reached).T:
                low, mid, high = np.min(counts), np.median(counts), np.max(counts)
                print(f" {mid:6.0f} ({low:.0f}, {high:.0f})".rjust(19), end="")
            low, mid, high = np.min(values), np.median(values), np.max(values)
            print(f"   {mid:.4f} ({low:.4f}, {high:.4f}) ± {np.mean(errors):.4f}", flush=True)


@pytest.mark.benchmark
def test_samples_to_levels_of_growth():
    table(SEEDS, SAMPLES)


@pytest.mark.benchmark
def test_strings_that_double_the_mean_size():
    doubling(SEEDS)


if __name__ == "__main__":
    if sys.argv[3:] == ["doubling"]:
        doubling(int(sys.argv[1]))
    else:
        table(int(sys.argv[1]), int(sys.argv[2]), sys.argv[3:] or tuple(SEARCHES))
