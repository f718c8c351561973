"""The posterior of jobs/measured against its known truth, and against direct simulations.

python tests/benchmarks/bench_data_posterior.py measured.h5 coverage
    Makes up 20 measurements of the truth, whose samples are simulated, and prints the highest
    posterior density level and the ranks of the truth in the posterior of each: it lies in the
    90 % region where its level is below 0.9. All rest on the emulator of the same file.
python tests/benchmarks/bench_data_posterior.py measured.h5 direct [STRINGS SAMPLES]
    Simulates strings about the posterior anew, by default 400 with 25 samples each, interpolates
    their predictions by a quadratic polynomial of the variables' logarithms, and prints the KS
    distance of each marginal from the posterior by that polynomial.
"""

import copy
import itertools
import runpy
import sys
import time
from pathlib import Path

import numpy as np

from agglom_mpi.emulation.blas_threads import single_threaded
from agglom_mpi.inference.data_posterior import data_posterior, posterior_of
from agglom_mpi.inference.string_values import pseudo_values
from agglom_mpi.storage.reader import read_campaign

MEASURE = Path(__file__).parents[2] / "jobs" / "measured" / "measure.py"
MEASUREMENTS, COUNTED, TRUE_SAMPLES = 20, 500, 300
FIRST_SAMPLE = 5000
"""Number of the first sample: other samples than those of the file."""
TEMPERING = 0.3
"""Strings are drawn with the posterior density to this power, so that they surround it."""
FARTHEST = 4.5
"""Farthest strings of the interpolation, in standard deviations of the posterior."""


def predicted(emulated, string, samples):
    """Return pseudo-values of new samples of a string, (samples, Q)."""
    campaign, numbers = emulated.box.campaign, range(FIRST_SAMPLE, FIRST_SAMPLE + samples)
    censuses = [campaign.simulate(string, k).measured.census for k in numbers]
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


def direct(posterior, count=400, samples=25):
    emulated, box = posterior.of, posterior.of.box
    weights = posterior.weights**TEMPERING
    random = np.random.default_rng(5)
    chosen = random.choice(len(weights), count, replace=False, p=weights / weights.sum())
    values = []
    for i in chosen:
        string = {v.name: float(v.values(posterior.strings[i][None])[0]) for v in box.own}
        values.append(predicted(emulated, string, samples).mean(axis=0) @ emulated.frame.basis)
    places = box.space.to_unit(posterior.strings)
    centre = posterior.weights @ places
    spread, axes = np.linalg.eigh(np.cov(places.T, aweights=posterior.weights))
    scaled = (places - centre) @ axes / np.sqrt(spread)
    near = np.abs(scaled[chosen]).max(axis=1) < FARTHEST
    terms, means = quadratic(scaled[chosen][near]), np.array(values)[near]
    fitted = np.linalg.lstsq(terms, means, rcond=None)[0]
    away = means - terms @ fitted
    noise = away.T @ away / (len(terms) - terms.shape[1])
    at = quadratic(scaled)
    errors = np.einsum("ni,ij,nj->n", at, np.linalg.inv(terms.T @ terms), at)
    covariance = np.eye(len(noise)) + errors[:, None, None] * noise
    residuals = emulated.frame.measured @ emulated.frame.basis - at @ fitted
    chi = np.einsum(
        "ni,ni->n", residuals, np.linalg.solve(covariance, residuals[..., None])[..., 0]
    )
    logarithms = -0.5 * (chi + np.linalg.slogdet(covariance)[1])
    simulated = np.exp(logarithms - logarithms.max())
    simulated /= simulated.sum()
    for i, name in enumerate(box.names):
        order = np.argsort(places[:, i])
        away = np.cumsum(posterior.weights[order]) - np.cumsum(simulated[order])
        print(f"{name}: KS {np.abs(away).max():.3f}")


def quadratic(places):
    """Return the terms of a quadratic polynomial at places, (n, d): (n, terms)."""
    pairs = itertools.combinations_with_replacement(range(places.shape[1]), 2)
    squares = [places[:, i] * places[:, j] for i, j in pairs]
    return np.column_stack([np.ones(len(places)), places, *squares])


def main(path, what, *numbers):
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
