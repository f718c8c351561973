"""How right feasible sets are, over seeds: their truth is simulated in the same run.

`bench_feasible_set.py QUESTION SAMPLES SEEDS [JOBS [FOLDER [AIM [BATCH [fresh]]]]]`, with the
question `three` (jobs/doubling_in_three.yaml), `nine` (jobs/accretion_2003.yaml), `half` (three
variables, growth by half), `plateau` (three variables, growth to three times the size, near which
the mean is flat), `moments` (three variables, mean and spread together) or `maximum` (three
variables, growth within 5 % of its maximum). Campaigns search with the surrogate, one sample
a string, for the `best` string or, with the aim `set`, for the set, in batches of 16 strings or
another number. With `fresh`, the sets rest on new samples at the strings of the campaigns, which
cannot have misled the search. With `three`, posteriors are compared with brute force, and ranks of
true values in them are counted. A folder keeps campaigns and the truth for the next time. Errors
are standard errors over the seeds.

The truth is the mean of b/b0, and its spread, at even points of the box. Points whose first samples
are in a window about the bounds get many more; no point gets more because of how near it is to a
bound, which would move it away. The points are then smoothed by an emulator of their own, whose
mean standard deviation in the window is printed; it rests on some hundred times the samples of a
campaign. As smoothing may bias it, points near the bounds are simulated once more with other
samples, and a quadratic of the emulated mean that is fitted to their deviations is added.
"""

import re
import sys
import tempfile
import time
from concurrent.futures import ProcessPoolExecutor
from contextlib import contextmanager, nullcontext
from itertools import pairwise
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pytest
from scipy.spatial import cKDTree
from scipy.stats import chisquare, kstest, qmc

from agglom_mpi.cli.invert import invert_command
from agglom_mpi.config.campaign import Campaign
from agglom_mpi.config.coordinates import coordinates_of
from agglom_mpi.emulation.joint_emulator import JointEmulator
from agglom_mpi.inference import feasible_set
from agglom_mpi.inference.feasible_set import FeasibleSet
from agglom_mpi.outcome import OUTCOME
from agglom_mpi.random_streams import sample_stream
from agglom_mpi.search.space import SearchSpace
from agglom_mpi.simulation.sample import simulate_scene
from agglom_mpi.storage.reader import read_campaign

JOBS = Path(__file__).parents[2] / "jobs"
BATCH, INITIAL = 16, 32
FIRST, WINDOW = 16, 0.35
"""Samples of a point to begin with; distance from a bound within which more are taken."""
FRESH = 10**6
"""Number of the first sample of the truth, which no search has seen."""
NEAR = 0.035
"""Distance from a bound of the points that tell how far emulated means are off there."""
LEAST = 0.01
"""P up to which a point is not counted in the reliability: nearly all of the box."""
CORRECTED, CHECKING = 0.1, 100_000
"""Distance from the bounds within which means are corrected; samples that the correction rests on.
"""
CENTRE = "{law: growth_target, ratio: 2}"


class Question(NamedTuple):
    """A question: its job, objective, tolerance, and points and samples of its truth."""

    job: str
    objective: str
    tolerance: float
    points: int
    most: int


QUESTIONS = {
    "three": Question("doubling_in_three", CENTRE, 0.05, 2048, 512),
    "half": Question("doubling_in_three", "{law: growth_target, ratio: 1.5}", 0.05, 2048, 512),
    "moments": Question(
        "doubling_in_three", "{law: moments, targets: {mean: 2, spread: 0.65}}", 0.1, 2048, 512
    ),
    "plateau": Question("doubling_in_three", "{law: growth_target, ratio: 3}", 0.05, 2048, 256),
    "maximum": Question("doubling_in_three", "{law: maximum_growth}", 0.05, 2048, 512),
    "nine": Question("accretion_2003", CENTRE, 0.05, 4096, 512),
}
SEEDS, SAMPLES = 20, 800


def campaign_text(name, seed, samples, aim="best", batch=BATCH):
    question = QUESTIONS[name]
    text = (JOBS / f"{question.job}.yaml").read_text()
    text = re.sub(r"(?m)^seed: .*$", f"seed: {seed}", text)
    head = text[: text.index("objective:")]
    generations = 2 + (samples - INITIAL) // batch
    plan = (
        f"search: {{method: surrogate, aim: {aim}, initial: {INITIAL}, batch: {batch}}}\n"
        f"ensemble: {{rule: fixed, samples: 1}}\nstopping: {{generations: {generations}}}\n"
    )
    return f"final: none\n{head}objective: {question.objective}\n{plan}"


def searched(name, seed, samples, folder, aim, batch):
    """Run a campaign of a question, and return its file."""
    path = Path(folder) / f"{name}_{seed}_{samples}_{aim}_{batch}.yaml"
    return campaign_file(path, campaign_text(name, seed, samples, aim, batch))


def campaign_file(path, text):
    """Run a campaign of this text, unless it was run before, and return its file."""
    from click.testing import CliRunner

    target = path.with_suffix(".h5")
    if target.exists():
        return read_campaign(target)
    path.write_text(text)
    done = CliRunner().invoke(invert_command, [str(path), "--output", str(target), "--quiet"])
    assert done.exit_code == 0, done.output
    return read_campaign(target)


def simulated(campaign, string, first, count):
    rows = np.zeros(count, OUTCOME)
    scene = campaign.scene.build(string)
    for k in range(count):
        rows[k] = simulate_scene(scene, sample_stream(7, string, first + k))[0]
    return rows


class Truth(NamedTuple):
    """Points of the box with the true values of what is compared, (n, q), and their error."""

    strings: np.ndarray
    values: np.ndarray
    error: float
    samples: int


def point_samples(arguments):
    """Samples of one point: the first ones, and more if they are near the bounds."""
    name, string = arguments
    campaign, question = Campaign.from_text(campaign_text(name, 1, 32)), QUESTIONS[name]
    criterion = campaign.objective.criterion(question.tolerance)
    rows = simulated(campaign, string, FRESH, FIRST)
    lower, upper = bounds_of(name, criterion)
    if lower - WINDOW < rows["mean_radius_ratio"].mean() < upper + WINDOW:
        more = simulated(campaign, string, FRESH + FIRST, question.most - FIRST)
        rows = np.concatenate((rows, more))
    return rows


def bounds_of(name, criterion):
    """Bounds of mean b/b0 about which the truth is told well."""
    return (criterion.share * 3.2, np.inf) if name == "maximum" else criterion.bounds()


def known_truth(name, jobs, folder):
    """Return the truth that a folder keeps, or a new one, which it keeps then."""
    path = Path(folder) / f"truth_{name}.npz"
    if path.exists():
        with np.load(path) as kept:
            return Truth(
                kept["strings"], kept["values"], float(kept["error"]), int(kept["samples"])
            )
    truth = truth_of(name, jobs)
    np.savez(path, **truth._asdict())
    return truth


def truth_of(name, jobs):
    campaign, question = Campaign.from_text(campaign_text(name, 1, 32)), QUESTIONS[name]
    space, coordinates = SearchSpace.of(campaign.variables), coordinates_of(campaign)
    criterion = campaign.objective.criterion(question.tolerance)
    units = qmc.Sobol(space.dimensions, seed=99).random(question.points)
    strings = space.from_unit(units)
    with ProcessPoolExecutor(jobs) as pool:
        samples = list(pool.map(point_samples, [(name, s) for s in strings], chunksize=32))
    points = coordinates.of_strings(strings)
    numbers = [criterion.numbers(rows, campaign.scene.particles) for rows in samples]
    own = np.array([criterion.compared(n.mean(axis=0)) for n in numbers])
    # Where nothing grows there is no noise; a smooth function through that would bend elsewhere.
    lower, upper = bounds_of(name, criterion)
    growth = np.array([rows["mean_radius_ratio"].mean() for rows in samples])
    fitted = (growth > lower - 2.0 * WINDOW) & (growth < upper + 2.0 * WINDOW)
    kept = np.repeat(np.arange(len(strings)), [len(rows) for rows in samples])
    some = fitted[kept]
    whole = JointEmulator(
        criterion.compared, points[kept][some], np.vstack(numbers)[some], np.random.default_rng(4)
    )
    long = np.array([len(rows) for rows in samples]) >= question.most
    error = whole.deviation(points[long])[:, 0].mean()
    more = space.from_unit(qmc.Sobol(space.dimensions, seed=5).random(1 << 14))
    if space.dimensions > 4:  # where points are far from each other, their own samples say most
        more = strings
    at = coordinates.of_strings(more)
    _, nearest = cKDTree(points).query(at)
    values = np.where(fitted[nearest][:, None], whole.mean_only(at), own[nearest])
    if criterion.quantities == ("mean_radius_ratio",) and np.isfinite(upper):
        values[:, 0] += bias(campaign, more, values[:, 0], (lower, upper))
    return Truth(more, values, float(error), len(kept))


def bias(campaign, strings, means, bounds):
    """Return the deviation of fresh samples from the means near the bounds, smooth in the mean."""
    lower, upper = bounds
    near = np.flatnonzero((means > lower - CORRECTED) & (means < upper + CORRECTED))
    count = max(CHECKING // len(near), 2)
    rows = [simulated(campaign, strings[i], 2 * FRESH, count) for i in near]
    away = np.array([r["mean_radius_ratio"].mean() for r in rows]) - means[near]
    noise = np.array([r["mean_radius_ratio"].std(ddof=1) for r in rows])
    middle = 0.5 * (lower + upper)
    # Weights by a smooth noise: that of a point goes with its mean where samples are skewed.
    weights = 1.0 / np.polyval(np.polyfit(means[near] - middle, noise, 1), means[near] - middle)
    fit = np.polyfit(means[near] - middle, away, 2, w=weights)
    found = np.zeros(len(means))
    found[near] = np.polyval(fit, means[near] - middle)
    for bound in bounds:
        print(f"the truth was off by {-np.polyval(fit, bound - middle):+.4f} at {bound:g}")
    return found


class Score(NamedTuple):
    """How right one set is; shares are of the true volume unless said otherwise."""

    relative_error: float
    expected_error: float
    volume_ratio: float
    coverage: float
    outer: float
    inner: float
    exponent: float
    calibrated: float
    away_at_lower: float
    """Mean deviation of the emulated mean from the truth near the lower bound of a band."""
    away_at_upper: float
    seconds: float


@contextmanager
def fresh_samples():
    """Let feasible sets rest on new samples at the same strings."""
    stored = feasible_set.stored_samples

    def simulated_again(data):
        kept, campaign = stored(data), feasible_set.recorded_campaign(data)
        rows = kept.rows.copy()
        for i, string in enumerate(kept.strings):
            # Numbers differ between the samples of one string; they start beyond those of truths.
            anew = simulated(campaign, string, 3 * FRESH + i, 1)[0]
            for column in OUTCOME.names:
                rows[i][column] = anew[column]
        return kept._replace(rows=rows)

    feasible_set.stored_samples = simulated_again
    try:
        yield
    finally:
        feasible_set.stored_samples = stored


def away_at(bound, truth, found):
    """Return the mean deviation of the emulated means of the points near a bound; nan without."""
    near = np.abs(truth.values[:, 0] - bound) < NEAR
    if not near.any():
        return np.nan
    means = found.emulated.mean(truth.strings[near])[:, 0]
    return (means - truth.values[near, 0]).mean()


def members(truth, found):
    if found.criterion.maximum is not None:
        return truth.values[:, 0] >= found.criterion.share * truth.values[:, 0].max()
    return found.criterion.holds(truth.values)


def score(name, seed, samples, truth, folder, aim="best", batch=BATCH):
    """Return the score of a campaign, and its probabilities and true members at the points."""
    file = searched(name, seed, samples, folder, aim, batch)
    began = time.perf_counter()
    found = FeasibleSet(file, QUESTIONS[name].tolerance)
    _ = found.volume_error, found.variables
    directions = found.directions
    seconds = time.perf_counter() - began
    inside, probability = members(truth, found), found.emulated.probability(truth.strings)
    wrong = np.sum((probability >= 0.5) != inside) / inside.sum()
    strings = truth.strings[inside]
    away = found.emulated.mean(strings)[:, 0] - truth.values[inside, 0]
    covered = np.abs(away) < 1.6449 * found.emulated.deviation(strings)[:, 0]
    return (
        found,
        Score(
            wrong,
            found.expected_error,
            probability.mean() / inside.mean(),  # at the same points, which share their luck
            covered.mean(),
            (probability >= 0.05)[inside].mean(),
            inside[probability >= 0.95].mean() if (probability >= 0.95).any() else np.nan,
            directions["hardness"][0] / directions["relative_speed"][0],
            float(found.calibration.passed),
            *(away_at(bound, truth, found) for bound in bounds_of(name, found.criterion)),
            seconds,
        ),
        (probability, inside),
    )


def run(name, samples, seeds, jobs=1, folder=None, aim="best", batch=BATCH, fresh=False):
    if folder is None:
        with tempfile.TemporaryDirectory() as scratch:
            run(name, samples, seeds, jobs, scratch, aim, batch, fresh)
        return
    began = time.perf_counter()
    truth = known_truth(name, jobs, folder)
    print(
        f"\n{name}, {samples} samples, aim {aim}, batches of {batch}: "
        f"truth by {truth.samples:,}, error {truth.error:.4f}, {time.perf_counter() - began:.0f} s",
        flush=True,
    )
    print("seed  " + "  ".join(f"{field:>14}" for field in Score._fields))
    scores, pairs = [], []
    posteriors = Posteriors(truth) if name == "three" else None
    for seed in range(1, seeds + 1):
        with fresh_samples() if fresh else nullcontext():
            found, row, pair = score(name, seed, samples, truth, folder, aim, batch)
        scores.append(row)
        pairs.append(pair)
        print(f"{seed:4}  " + "  ".join(f"{value:14.4f}" for value in row), flush=True)
        if posteriors is not None:
            posteriors.add(found)
    table = np.array(scores)
    error = table.std(0, ddof=min(1, seeds - 1)) / np.sqrt(seeds)
    rows = {"mean": table.mean(0), "error": error, "least": table.min(0), "most": table.max(0)}
    for label, row in rows.items():
        print(f"{label:5} " + "  ".join(f"{value:14.4f}" for value in row), flush=True)
    print_reliability(pairs)
    if posteriors is not None:
        posteriors.show()


def print_reliability(pairs):
    """Print true shares against P; `pairs` are P and true members at the points, for each seed."""
    tenths, fifths = np.arange(11) / 10, np.arange(6) / 5
    for title, edges in (("ten bins", tenths), ("five bins", fifths), ("middle", (0.15, 0.85))):
        print(f"true share against P, all seeds, {title}:")
        for lower, upper in pairwise(edges):
            row = reliability(pairs, max(lower, LEAST), upper)
            if row is not None:
                print(
                    f"  P {lower:.2f} to {upper:.2f}, mean {row.believed:.3f}  share {row.true:.3f}"
                    f"  away {row.true - row.believed:+.3f} ± {row.error:.3f}  {row.points} points"
                )


class Reliability(NamedTuple):
    """Mean P and true share of the points of one bin, the error of their difference, and points."""

    believed: float
    true: float
    error: float
    points: int


def reliability(pairs, lower, upper):
    """Return the reliability of P in (lower, upper]; None without points."""
    bins = [(p > lower) & (p <= upper) for p, _ in pairs]
    count = np.array([some.sum() for some in bins])
    total = count.sum()
    if not total:
        return None
    believed = np.array([p[some].sum() for some, (p, _) in zip(bins, pairs, strict=True)])
    true = np.array([inside[some].sum() for some, (_, inside) in zip(bins, pairs, strict=True)])
    # Points of one seed share their luck: the error is that of a ratio of sums over seeds.
    away = (true - believed).sum() / total
    squares = (((true - believed) - away * count) ** 2).sum() * len(pairs) / max(len(pairs) - 1, 1)
    return Reliability(believed.sum() / total, true.sum() / total, np.sqrt(squares) / total, total)


class Posteriors:
    """Posteriors of campaigns against brute force on the truth, and ranks of true values."""

    error = 0.05

    def __init__(self, truth):
        coordinates = coordinates_of(Campaign.from_text(campaign_text("three", 1, 32)))
        self.names, self.of = coordinates.names, coordinates.own
        self.own, self.growth = self.of(truth.strings), truth.values[:, 0]
        self.weights = np.exp(-0.5 * ((self.growth - 2.0) / self.error) ** 2)
        self.rng, self.ranks, self.distances, self.sizes = np.random.default_rng(1), [], [], []

    def add(self, found, draws=10):
        """Compare the posterior of one campaign, and rank values of `draws` others."""
        posterior = found.posterior(2.0, self.error)
        self.sizes.append(posterior.effective_size)
        mine = self.of(posterior.strings)
        pairs = zip(mine.T, self.own.T, strict=True)
        self.distances.append(
            [weighted_ks(a, posterior.weights, b, self.weights) for a, b in pairs]
        )
        # True strings from the prior, as far as their growth tells anything.
        for at in self.rng.integers(len(self.growth), size=draws):
            measured = self.growth[at] + self.error * self.rng.normal()
            drawn = found.posterior(measured, self.error)
            below = self.of(drawn.strings) < self.own[at]
            self.ranks.append([drawn.weights[column].sum() for column in below.T])

    def show(self):
        print(f"posterior of 2.00 ± {self.error}, {len(self.sizes)} campaigns")
        print(f"effective size {np.min(self.sizes):.0f} to {np.max(self.sizes):.0f}")
        for i, name in enumerate(self.names):
            mean, most = np.mean(self.distances, 0)[i], np.max(self.distances, 0)[i]
            values = np.array(self.ranks)[:, i]
            counts = np.histogram(values, np.linspace(0.0, 1.0, 11))[0]
            print(
                f"{name}: KS distance {mean:.3f}, at most {most:.3f}; {len(values)} ranks uniform "
                f"with p = {kstest(values, 'uniform').pvalue:.2f} (KS), "
                f"{chisquare(counts).pvalue:.2f} (chi2)",
                flush=True,
            )


def weighted_ks(one, of_one, other, of_other):
    """Largest distance of two weighted distribution functions."""
    grid = np.sort(np.concatenate((one, other)))
    both = []
    for values, weights in ((one, of_one), (other, of_other)):
        order = np.argsort(values)
        below = np.concatenate(([0.0], np.cumsum(weights[order]) / weights.sum()))
        both.append(below[np.searchsorted(values[order], grid, side="right")])
    return float(np.abs(both[0] - both[1]).max())


@pytest.mark.benchmark
@pytest.mark.parametrize("name", QUESTIONS)
def test_print_how_right_the_set_of_a_question_is(name):
    run(name, SAMPLES, SEEDS)


if __name__ == "__main__":
    what, samples, seeds, *rest = sys.argv[1:]
    jobs = int(rest[0]) if rest else 1
    batch = int(rest[3]) if len(rest) > 3 else BATCH
    run(what, int(samples), int(seeds), jobs, *rest[1:3], batch=batch, fresh=rest[4:] == ["fresh"])
