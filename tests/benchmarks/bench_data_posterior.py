"""Posteriors against known truths, and against direct simulations.

python tests/benchmarks/bench_data_posterior.py measured.h5 coverage
    Makes up 20 measurements of the truth of jobs/measured, whose samples are simulated, and prints
    the highest posterior density level and the ranks of the truth in the posterior of each: it lies
    in the 90 % region where its level is below 0.9. All rest on the emulator of the same file.
python tests/benchmarks/bench_data_posterior.py FOLDER campaigns [FIRST LAST]
    The same with a campaign and an emulator for each measurement, with seeds from 1 to 20.
python tests/benchmarks/bench_data_posterior.py FOLDER experiments [FIRST LAST]
    The same of two experiments that share a liquid, each time of another truth, drawn evenly from
    the box. What is ranked first to measure next is then simulated at the truth and measured;
    prints the volume of the posterior after it, and the mean of its ratio to the expected one.
python tests/benchmarks/bench_data_posterior.py FILE.h5 direct [SAMPLES]
    Simulates strings anew on a grid along the principal axes of the posterior, 41 by 11 by 11 over
    3.5 standard deviations to each side, by default with 10 samples each. Their predictions are
    interpolated by polynomials of the third and fourth degree; prints how far the strings are from
    these in units of their own noise, about 1 if the degree suffices, and the KS distance of each
    marginal from the posterior by that polynomial.
"""

import math
import re
import runpy
import shutil
import sys
import time
from pathlib import Path

import numpy as np

TESTS = Path(__file__).parents[1]
sys.path.append(str(TESTS / "helpers"))

from direct_simulations import (  # noqa: E402
    SimulatedGrid,
    level_of,
    measured_anew,
    predicted,
    volume_after,
    with_measurement,
    with_values,
)
from two_experiments import ERROR, SEARCHED, drawn_truths, write_two  # noqa: E402

import agglom_mpi  # noqa: E402
from agglom_mpi.emulation.blas_threads import single_threaded  # noqa: E402
from agglom_mpi.inference.data_posterior import data_posterior, posterior_of  # noqa: E402
from agglom_mpi.inference.searched_box import SearchedBox  # noqa: E402
from agglom_mpi.storage.reader import read_campaign  # noqa: E402

MEASURE = TESTS.parent / "jobs" / "measured" / "measure.py"
MEASUREMENTS, COUNTED, TRUE_SAMPLES = 20, 500, 300
DEGREES = (3, 4)


def coverage(emulated):
    truth = runpy.run_path(str(MEASURE))["TRUTH"]
    [string] = emulated.box.strings(truth)
    campaign, random = emulated.box.campaign, np.random.default_rng(11)
    values = predicted(campaign, string, emulated.data, TRUE_SAMPLES).mean(axis=0)
    levels = []
    for i in range(MEASUREMENTS):
        other = with_values(emulated, measured_anew(emulated, values, random, COUNTED))
        found = posterior_of(other)
        levels.append(level_of(other, found, string))
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
        _, level = found_of(place / "measured.yaml", measure["TRUTH"])
        inside += level < 0.9
    print(f"truth in the 90 % region of {inside} of {last - first + 1} campaigns")


def found_of(path, truth):
    """Return the posterior of a campaign that is run, printing where it has the truth, by name."""
    campaign = agglom_mpi.load_campaign(path)
    found = campaign.run(output=path.with_suffix(".h5"), progress=False).posterior()
    level = level_of(found.of, found, found.of.box.strings(truth))
    ranks = [float(found.weights @ (found.draws[n] < v).to_numpy()) for n, v in truth.items()]
    verdict = "calibrated" if found.calibration.passed else found.calibration.text
    places = f"level {level:.3f} ranks {np.round(ranks, 3)}"
    print(f"{campaign.seed} {places} p {found.p_value:.2g} {verdict}", flush=True)
    return found, level


def experiments(folder, first=1, last=MEASUREMENTS):
    inside, ratios = 0, []
    for seed in range(first, last + 1):
        random = np.random.default_rng(seed)
        path = write_two(Path(folder) / str(seed), is_rough=False, search=SEARCHED, seed=seed)
        campaign = agglom_mpi.load_campaign(path)
        box = SearchedBox(campaign)
        [string] = drawn_truths(box, 1, random)
        means = predicted(campaign, string, campaign.data, TRUE_SAMPLES).mean(axis=0)
        values = random.normal(means, ERROR)
        write_two(path.parent, values, is_rough=False, search=SEARCHED, seed=seed)
        found, level = found_of(path, {v.name: float(v.values(string[None])[0]) for v in box.own})
        inside += level < 0.9
        ratios.append(found_over_expected(found, string, random))
    count = last - first + 1
    print(f"truth in the 90 % region of {inside} of {count} campaigns")
    error = np.std(ratios, ddof=1) / math.sqrt(count)
    print(
        f"volume after the next measurement over the expected: {np.mean(ratios):.3f} ± {error:.3f}"
    )


@single_threaded
def found_over_expected(posterior, string, random):
    """Return the volume after the measurement that is ranked first, over the expected one."""
    next_ones = posterior.next_measurements()
    each = next_ones.ranked[0]
    emulated = with_measurement(posterior, each)
    campaign = posterior.of.box.campaign
    value = predicted(campaign, string, emulated.data[-1:], TRUE_SAMPLES).mean(axis=0)
    volume = volume_after(emulated, value, random)
    volumes = f"{next_ones.volume:.4g}, expected {each.after.value:.4g}, found {volume:.4g}"
    print(f"  {each.name}, {each.error_text}: {volumes}", flush=True)
    return volume / each.after.value


def direct(posterior, samples=10):
    grid = SimulatedGrid(posterior.of, posterior, samples)
    print(f"{len(grid.grid)} strings of {samples} samples")
    print(f"{grid.outside:.2g} of the posterior is outside of the grid")
    for degree in DEGREES:
        excess, distances = grid.compared(degree)
        print(f"degree {degree}: scatter over noise {excess.min():.2f} to {excess.max():.2f}")
        for name, distance in zip(posterior.of.box.names, distances, strict=True):
            print(f"  {name}: KS {distance:.3f}")


def main(path, what, *numbers):
    if what in (of_folders := {"campaigns": campaigns, "experiments": experiments}):
        of_folders[what](path, *map(int, numbers))
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
