"""How many samples of a second question on a scene are saved by what a first one has learned.

`bench_learning.py FOLDER SEEDS FIRST SECOND [MOST]`: FIRST samples of a search for the set of
`half` (growth by half), then SECOND of one for the set of `three` (growth to twice the size) that
learns from it, and as many of one that does not; see `bench_feasible_set.py`, also for the error of
a set, which is taken as the campaigns go on. The folder keeps campaigns and the truth; MOST is the
maximum number of samples of a point of a new truth. The numbers of `search/README` are of four
seeds, 400 samples and then 208, and a truth of 1024 points with at most 64 samples each, corrected
by 20,000 others.
"""

import sys
from pathlib import Path

import bench_feasible_set as bench
import numpy as np

from agglom_mpi.accuracy.answer.runs import until
from agglom_mpi.inference.emulated_set import EmulatedSet
from agglom_mpi.inference.searched_box import SearchedBox
from agglom_mpi.inference.stored_samples import MIN_STRINGS, stored_samples
from agglom_mpi.storage.recorded_campaign import recorded_campaign

SHOWN = (32, 64, 112, 208, 400, 800)
"""Numbers of samples after which errors are shown."""


def errors_of(file, truth):
    """Yield number of samples of a campaign, and the error of its set then."""
    campaign = recorded_campaign(file)
    criterion = campaign.objective.criterion(bench.QUESTIONS["three"].tolerance)
    inside = criterion.holds(truth.values)
    for row in file.generation_rows():
        used = int(row["samples_used"])
        stored = stored_samples(until(file, int(row["generation"])))
        if used not in SHOWN or len(stored.strings) < MIN_STRINGS:
            continue
        probability = EmulatedSet(SearchedBox(campaign), criterion, stored).probability(
            truth.strings
        )
        yield used, np.sum((probability >= 0.5) != inside) / inside.sum()


def run(folder, seeds, first, second):
    truth = bench.known_truth("three", 1, folder)
    print(f"truth by {truth.samples:,} samples, error {truth.error:.4f}", flush=True)
    found = {}
    for seed in range(1, seeds + 1):
        earlier = bench.searched("half", 1000 + seed, first, folder, "set", bench.BATCH)
        text = bench.campaign_text("three", seed, second, "set")
        learning = text.replace("aim: set", f"aim: set, learn_from: {earlier.path.name}")
        for name, each in (("alone", text), ("learning", learning)):
            file = bench.campaign_file(Path(folder) / f"second_{name}_{seed}.yaml", each)
            for used, error in errors_of(file, truth):
                print(f"seed {seed}  {name:8}  {used:4} samples  {error:.4f}", flush=True)
                found.setdefault((name, used), []).append(error)
    for (name, used), errors in sorted(found.items()):
        deviation = np.std(errors, ddof=min(1, len(errors) - 1)) / np.sqrt(len(errors))
        print(f"{name:8}  {used:4} samples  {np.mean(errors):.4f} ± {deviation:.4f}", flush=True)


if __name__ == "__main__":
    place, *numbers = sys.argv[1:]
    seeds, first, second, *most = map(int, numbers)
    if most:
        bench.QUESTIONS["three"] = bench.QUESTIONS["three"]._replace(most=most[0])
    run(place, seeds, first, second)
