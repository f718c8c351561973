"""Speed of samples and elastic gases, and means of the papers' strings, of installations in turn.

Run with `pytest tests/benchmarks/bench_samples.py -m benchmark -s`, or as a program with the Python
interpreters of the installations to compare as arguments, an older one first:
`python bench_samples.py speed OLD NEW`, `... million OLD NEW`, `... means OLD NEW`. Each runs what
every version since 0.1 offers: `load_campaign` and `simulate`.
"""

import json
import math
import statistics
import subprocess
import sys
import tempfile
from pathlib import Path

import pytest
from bench_event import JOBS, ROWS, print_row

from agglom_mpi.report.sections.published import read_published
from agglom_mpi.variables import TEN

REPEATS = 5
PROGRAM = """
import json, sys, time
from agglom_mpi import load_campaign

def seconds(campaign, values, samples):
    begin = time.process_time()
    outcomes = [campaign.simulate(values, sample) for sample in samples]
    return time.process_time() - begin, outcomes

for line in sys.stdin:
    path, values, samples, want = json.loads(line)
    campaign = load_campaign(path)
    campaign.simulate(values, 0)
    spent, outcomes = seconds(campaign, values, range(samples))
    if want == "means":
        print(json.dumps([outcome.mean_radius_ratio for outcome in outcomes]), flush=True)
    else:
        # An earlier installation has wall-clock time alone.
        inside = sum(getattr(o, "cpu_seconds", o.seconds) for o in outcomes)
        collisions = sum(outcome.collisions for outcome in outcomes)
        print(json.dumps([spent, collisions, inside]), flush=True)
"""
GAS = """
title: an elastic gas
seed: 1
scene:
  particles: {particles}
  half_width: 1 cm
  velocities: {{law: spread, mean: [0, 0, 0], transverse: 1}}
  restitution: {{law: constant, value: 1}}
  heating: none
  end_time: {end_time:.6g} s
  engine: {{law: event, budget: 1000000}}
variables: {{relative_speed: 10, size_ratio: 0.7256, density: 5000, friction: 0}}
"""
GASES = {100: 1000, 1000: 100, 10_000: 10}
"""Collisions of a grain that are timed, by the number of grains; the volume fraction is 0.2."""
RATE_OF_1000 = 1.9e4
"""Collisions of a grain per s in the gas of 1000 grains, about; they go as the third root of N."""
SAMPLES = {"accretion_2003": (400, 4000), "agglomeration_2004": (20, 400)}
"""Samples that are timed, and those of a mean."""


class Installation:
    """A process of an installation that simulates what it is asked for."""

    def __init__(self, python):
        self.name = python
        self.folder = tempfile.TemporaryDirectory()
        self.process = subprocess.Popen(
            [python, "-c", PROGRAM],
            cwd=self.folder.name,  # imports nothing from here
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
            bufsize=1,
        )

    def ask(self, path, values, samples, want="speed"):
        """What it prints of these samples."""
        self.process.stdin.write(json.dumps([str(path), values, samples, want]) + "\n")
        return json.loads(self.process.stdout.readline())

    def end(self):
        self.process.stdin.close()
        assert self.process.wait() == 0
        self.folder.cleanup()


def in_turn(pythons, ask, repeats=REPEATS):
    """Medians over rounds of what `ask` returns of each installation, one after another."""
    installations = [Installation(python) for python in pythons]
    rounds = [[ask(one) for one in installations] for _ in range(repeats)]
    for one in installations:
        one.end()
    return [statistics.median(values) for values in zip(*rounds, strict=True)]


def print_ratio(label, values, unit):
    ratio = f"{values[-1] / values[0]:.3f} of the first" if len(values) > 1 else ""
    print_row((38, *[14] * len(values), 20), (label, *(f"{v:.4g} {unit}" for v in values), ratio))


def print_speed(pythons):
    print(f"\nprocessor time, medians of {REPEATS}, installations in turn")
    for job, (row, _) in ROWS.items():
        values = dict(zip(TEN.names, row, strict=False))

        def ms(one, place, job=job, values=values):
            count = SAMPLES[job][0]
            return 1e3 * one.ask(JOBS / f"{job}.yaml", values, count)[place] / count

        print_ratio(f"campaign.simulate, {job}", in_turn(pythons, lambda one: ms(one, 0)), "ms")
        print_ratio(
            "  of it the sample, as ranks run it", in_turn(pythons, lambda one: ms(one, 2)), "ms"
        )
    for count, collisions in GASES.items():
        print_ratio(f"a collision of {count} elastic grains", gas(pythons, count, collisions), "µs")


def print_million(pythons):
    print("\nprocessor time of a collision of an elastic gas, medians of 3, in turn")
    for count, collisions in ((1000, 100), (1_000_000, 2)):
        values = gas(pythons, count, collisions, 3)
        print_ratio(f"a collision of {count} elastic grains", values, "µs")


def gas(pythons, count, collisions, repeats=REPEATS):
    """Microseconds of processor time per collision: a long run, less one that ends at once."""
    rate = RATE_OF_1000 * (count / 1000) ** (1.0 / 3.0)
    with tempfile.TemporaryDirectory() as folder:
        paths = [Path(folder) / name for name in ("long.yaml", "short.yaml")]
        for path, time in zip(paths, (collisions / rate, 1e-6 * collisions / rate), strict=True):
            path.write_text(GAS.format(particles=count, end_time=time))

        def microseconds(one):
            one.ask(paths[1], {}, 1)  # memory that is new takes longer
            (long, found, _), (short, few, _) = (one.ask(path, {}, 1) for path in paths)
            return 1e6 * (long - short) / (found - few)

        return in_turn(pythons, microseconds, repeats)


def print_means(pythons):
    print("\nmean b/b0 of the papers' strings, from the same random starts")
    widths = (22, 5, *[20] * len(pythons), 22)
    for job in SAMPLES:
        installations = [Installation(python) for python in pythons]
        for number, values in enumerate(
            read_published(JOBS / "published" / f"{job}.json").strings()
        ):
            found = []
            for one in installations:
                path = JOBS / f"{job}.yaml"
                ratios = one.ask(path, values, SAMPLES[job][1], "means")
                error = statistics.stdev(ratios) / math.sqrt(len(ratios))
                found.append((statistics.mean(ratios), error))
            print_row(
                widths, (job, number + 1, *(f"{m:.5f} ± {e:.5f}" for m, e in found), apart(found))
            )
        for one in installations:
            one.end()


def apart(found):
    """How far the last mean is from the first, in standard errors of their difference."""
    (first, error), (last, other) = found[0], found[-1]
    return f"{(last - first) / math.hypot(error, other):+.2f} standard errors" if error else ""


@pytest.mark.benchmark
def test_print_the_speed_of_samples():
    print_speed([sys.executable])


if __name__ == "__main__":
    {"speed": print_speed, "million": print_million, "means": print_means}[sys.argv[1]](
        sys.argv[2:]
    )
