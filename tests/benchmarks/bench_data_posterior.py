"""The posterior of jobs/measured against its known truth, and against direct simulations.

python tests/benchmarks/bench_data_posterior.py measured.h5 coverage
    Makes up 20 measurements of the truth, whose samples are simulated, and prints the highest
    posterior density level and the ranks of the truth in the posterior of each: it lies in the
    90 % region where its level is below 0.9. All rest on the emulator of the same file.
python tests/benchmarks/bench_data_posterior.py FOLDER campaigns [FIRST LAST]
    The same with a campaign and an emulator for each measurement, with seeds from 1 to 20.
python tests/benchmarks/bench_data_posterior.py measured.h5 direct [SAMPLES]
    Simulates strings anew on a grid along the principal axes of the posterior, 41 by 11 by 11 over
    3.5 standard deviations to each side, by default with 10 samples each. Their predictions are
    interpolated by polynomials of the third and fourth degree; prints how far the strings are from
    these in units of their own noise, about 1 if the degree suffices, and the KS distance of each
    marginal from the posterior by that polynomial.
"""

import copy
import itertools
import re
import runpy
import shutil
import sys
import time
from pathlib import Path

import numpy as np

import agglom_mpi
from agglom_mpi.emulation.blas_threads import single_threaded
from agglom_mpi.inference.data_posterior import data_posterior, posterior_of
from agglom_mpi.inference.stored_samples import pseudo_values
from agglom_mpi.storage.reader import read_campaign
from agglom_mpi.verbs.simulate import simulate

MEASURE = Path(__file__).parents[2] / "jobs" / "measured" / "measure.py"
MEASUREMENTS, COUNTED, TRUE_SAMPLES = 20, 500, 300
FIRST_SAMPLE = 5000
"""Number of the first sample: other samples than those of the file."""
GRID = (41, 11, 11)
"""Strings along each principal axis, the longest first."""
REACH = 3.5
"""Ends of the grid, in standard deviations of the posterior."""
DEGREES = (3, 4)


def predicted(emulated, string, samples):
    """Return pseudo-values of new samples of a string, (samples, Q)."""
    campaign, numbers = emulated.box.campaign, range(FIRST_SAMPLE, FIRST_SAMPLE + samples)
    censuses = [simulate(campaign, string, k).measured.census for k in numbers]
    census = campaign.measured_at(campaign.parameters(string)).census(censuses)
    return pseudo_values(census, emulated.data)


def measured_anew(emulated, values, random):
    """Return the emulator with another measurement of the true values, (Q,)."""
    made = []
    for datum, rows in zip(emulated.data, emulated.frame.rows, strict=True):
        if datum.quantity == "sizes":
            shares = np.maximum(values[rows], 0.0)
            made.append(random.multinomial(COUNTED, shares / shares.sum()) / COUNTED)
        else:
            made.append(random.normal(values[rows], np.sqrt(np.diag(datum.covariance))))
    other = copy.copy(emulated)
    other.__dict__.pop("_nearest", None)  # of other data
    all_values = np.concatenate(made)
    other.measured = emulated.numbers_of(all_values)
    framed = all_values @ emulated.frame.basis - emulated.centre
    other.left_out_measured = framed @ emulated.left_out
    return other


def coverage(emulated):
    truth = runpy.run_path(str(MEASURE))["TRUTH"]
    values = predicted(emulated, truth, TRUE_SAMPLES).mean(axis=0)
    string, random, levels = emulated.box.strings(truth), np.random.default_rng(11), []
    for i in range(MEASUREMENTS):
        other = measured_anew(emulated, values, random)
        found = posterior_of(other)
        higher = other.log_density(found.strings) > other.log_density(string)[0]
        levels.append(float(found.weights @ higher))
        ranks = [float(found.weights @ (found.draws[n] < v).to_numpy()) for n, v in truth.items()]
        print(i, f"level {levels[-1]:.2f}, ranks {np.round(ranks, 2)}", flush=True)
    inside = int(np.sum(np.array(levels) < 0.9))
    print(f"truth in the 90 % region of {inside} of {MEASUREMENTS} measurements")


def campaigns(folder, first=1, last=MEASUREMENTS):
    inside = 0
    for seed in range(first, last + 1):
        place = Path(folder) / str(seed)
        shutil.copytree(MEASURE.parent, place)
        measure = runpy.run_path(str(place / MEASURE.name))
        kelvin = measure["measure"](np.random.default_rng(seed))
        text = (place / "measured.yaml").read_text()
        text, count = re.subn("value: [0-9.]+ K", f"value: {kelvin:.4f} K", text)
        assert count == 1
        (place / "measured.yaml").write_text(text.replace("seed: 1", f"seed: {seed}"))
        campaign = agglom_mpi.load_campaign(place / "measured.yaml")
        found = campaign.run(output=place / "measured.h5", progress=False).posterior()
        truth = measure["TRUTH"]
        string = found.of.box.strings(truth)
        higher = found.of.log_density(found.strings) > found.of.log_density(string)[0]
        level = float(found.weights @ higher)
        ranks = [float(found.weights @ (found.draws[n] < v).to_numpy()) for n, v in truth.items()]
        inside += level < 0.9
        verdict = "calibrated" if found.calibration.passed else found.calibration.text
        print(
            f"{seed} level {level:.3f} ranks {np.round(ranks, 3)} p {found.p_value:.2g} {verdict}"
        )
        sys.stdout.flush()
    print(f"truth in the 90 % region of {inside} of {last - first + 1} campaigns")


def direct(posterior, samples=10):
    emulated, box = posterior.of, posterior.of.box
    places = box.space.to_unit(posterior.strings)
    centre = posterior.weights @ places
    spread, axes = np.linalg.eigh(np.cov(places.T, aweights=posterior.weights))
    axes, lengths = axes[:, ::-1], np.sqrt(spread[::-1])
    scaled = (places - centre) @ axes / lengths
    ends = [np.linspace(-REACH, REACH, n) for n in GRID]
    grid = np.stack(np.meshgrid(*ends, indexing="ij"), axis=-1).reshape(-1, len(GRID))
    units = centre + grid * lengths @ axes.T
    inside = ((units >= 0.0) & (units <= 1.0)).all(axis=1)
    grid, strings = grid[inside], box.space.from_unit(units[inside])
    means, noise = [], 0.0
    for string in strings:
        named = {v.name: float(v.values(string[None])[0]) for v in box.own}
        values = predicted(emulated, named, samples) @ emulated.frame.basis
        means.append(values.mean(axis=0))
        noise = noise + np.cov(values.T) / samples / len(strings)
    means = np.array(means)
    print(f"{len(strings)} strings of {samples} samples")
    near = np.abs(scaled).max(axis=1) < REACH
    places, scaled, weights = places[near], scaled[near], posterior.weights[near]
    print(f"{1.0 - weights.sum():.2g} of the posterior is outside of the grid")
    weights = weights / weights.sum()
    for degree in DEGREES:
        terms, at = polynomial(grid, degree), polynomial(scaled, degree)
        fitted = np.linalg.lstsq(terms, means, rcond=None)[0]
        away = means - terms @ fitted
        excess = (away**2).sum(axis=0) / (len(terms) - terms.shape[1]) / np.diag(noise)
        residuals = emulated.frame.measured @ emulated.frame.basis - at @ fitted
        logarithms = -0.5 * (residuals**2).sum(axis=1)
        simulated = np.exp(logarithms - logarithms.max())
        simulated /= simulated.sum()
        print(f"degree {degree}: scatter over noise {excess.min():.2f} to {excess.max():.2f}")
        for i, name in enumerate(box.names):
            order = np.argsort(places[:, i])
            apart = np.cumsum(weights[order]) - np.cumsum(simulated[order])
            print(f"  {name}: KS {np.abs(apart).max():.3f}")


def polynomial(places, degree):
    """Return the terms of a polynomial at places, (n, d), shape (n, terms)."""
    terms = [np.ones(len(places))]
    for power in range(1, degree + 1):
        for chosen in itertools.combinations_with_replacement(range(places.shape[1]), power):
            terms.append(np.prod(places[:, chosen], axis=1))
    return np.column_stack(terms)


def main(path, what, *numbers):
    if what == "campaigns":
        campaigns(path, *map(int, numbers))
        return
    begun, cpu = time.perf_counter(), time.process_time()
    posterior = data_posterior(read_campaign(path))
    seconds, busy = time.perf_counter() - begun, time.process_time() - cpu
    print(f"{posterior!r}\n{posterior.calibration.text}")
    print(f"{seconds:.1f} s, of a processor {busy:.1f} s", flush=True)
    if what == "coverage":
        single_threaded(coverage)(posterior.of)
    else:
        single_threaded(direct)(posterior, *map(int, numbers))


if __name__ == "__main__":
    main(*sys.argv[1:])
