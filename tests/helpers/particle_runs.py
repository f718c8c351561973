"""Campaigns that keep particles, and what must be in their files."""

import numpy as np
from campaign_runs import write_campaign

from agglom_mpi.campaign_file import open_campaign
from agglom_mpi.config.loading import load_campaign
from agglom_mpi.outcome import COMPLETED
from agglom_mpi.storage.reader import read_campaign
from agglom_mpi.variables import TEN
from agglom_mpi.verbs.simulate import simulate

COUNT, STRINGS, SAMPLES = 5, 3, 2
FRAMES = f"frames: {{count: {COUNT}, strings: {STRINGS}, samples: {SAMPLES}}}"
BOTH = f"final_particles: true, {FRAMES}"


def write_bulk_campaign(path, output=BOTH, **numbers):
    """Write the quickstart campaign with other numbers and an output section."""
    write_campaign(path, **numbers)
    if output:
        path.write_text(f"{path.read_text().rstrip()}\n\noutput: {{{output}}}\n")
    return path


def pictures_wanted(path, strings=STRINGS, samples=SAMPLES):
    """Return the first samples of the strings with the lowest objectives."""
    best = open_campaign(path).best(strings)["string"]
    return [(int(string), sample) for string in best for sample in range(samples)]


def assert_particles_are_those_of_the_samples(path, campaign_path):
    """Compare everything there is of particles with what the campaign computes for everybody.

    Return the samples with final particles and those with pictures.
    """
    file, campaign = read_campaign(path), load_campaign(str(campaign_path))
    strings = file.string_rows()
    parameters = {
        int(row["string"]): np.array([row[name] for name in TEN.names]) for row in strings
    }
    kept = []
    for row in file.all_sample_rows():
        pair = int(row["string"]), int(row["sample"])
        if (final := file.particles.final(*pair)) is not None:
            assert row["state"] == COMPLETED
            assert_same_arrays(final, simulate(campaign, parameters[pair[0]], pair[1]).final)
            assert len(final.radii) == row["particles"]
            kept.append(pair)
    for string, sample in file.particles.framed():
        outcome = simulate(campaign, parameters[string], sample, frames=COUNT)
        found = file.particles.frames(string, sample)
        # A kill may have come between two pictures of a sample.
        taken = np.isin(outcome.frames.times, found.times)
        assert taken.all() or file.status().state == "running"
        arrays = (array if array is None else array[taken] for array in outcome.frames)
        wanted = type(outcome.frames)(*arrays)
        assert_same_arrays(found, wanted)
    return kept, file.particles.framed()


def assert_same_arrays(found, wanted):
    """Compare named tuples of arrays bit for bit."""
    for name, array in wanted._asdict().items():
        stored = getattr(found, name)
        if array is None:  # spins of grains that have none
            assert stored is None
            continue
        assert (stored.dtype, stored.shape) == (array.dtype, array.shape), name
        assert stored.tobytes() == array.tobytes(), name


def pairs_of(rows):
    """Return string and number of samples."""
    return [tuple(pair) for pair in rows[["string", "sample"]].tolist()]
