"""Several files of one question with other seeds: their samples count together."""

import json

import numpy as np
import pytest
from campaign_runs import invert
from click.testing import CliRunner
from measured_runs import write_measured
from set_runs import three_variable_file

from agglom_mpi.analysis.file_comparison import PoolingError, pooled
from agglom_mpi.inference.stored_samples import stored_samples, string_values
from agglom_mpi.storage.reader import read_campaign
from agglom_mpi.storage.recorded_campaign import recorded_campaign


def report(*arguments):
    from agglom_mpi.cli import main

    return CliRunner().invoke(main, ["report", *map(str, arguments)])


@pytest.fixture(scope="module")
def other_seed(tmp_path_factory):
    folder = tmp_path_factory.mktemp("other")
    three_variable_file(folder, seed=77)
    return folder / "three.h5"


@pytest.fixture(scope="module")
def seeds(tmp_path_factory):
    """Return two files of a campaign with data, whose sizes are drawn."""
    folder = tmp_path_factory.mktemp("seeds")
    write_measured(folder)
    paths = [folder / f"seed{seed}.h5" for seed in (1, 2)]
    for seed, path in enumerate(paths, 1):
        options = "--seed", str(seed), "--output", path.name
        assert invert(folder, "measured.yaml", *options).returncode == 0
    return [next(folder.glob(f"{path.stem}*.h5")) for path in paths]


def test_a_set_rests_on_the_samples_of_all_files(three, other_seed, tmp_path):
    sets = {}
    for name, files in (("one", [three.path]), ("both", [three.path, other_seed])):
        done = report(*files, "--feasible-set", "--json")
        assert done.exit_code == 0, done.output
        sets[name] = json.loads(done.stdout)
    samples = [len(read_campaign(path).counted_samples) for path in (three.path, other_seed)]
    assert sets["one"]["samples"] == samples[0]
    assert sets["both"]["samples"] == sum(samples)
    assert sets["both"]["strings"] > sets["one"]["strings"]


def test_predictions_for_data_are_those_of_each_file(seeds):
    files = [read_campaign(path) for path in seeds]
    data = recorded_campaign(files[0]).data
    alone = [string_values(file, data) for file in files]
    samples = [len(stored_samples(file).rows) for file in files]
    together = string_values(pooled(files), data)
    assert np.array_equal(together.values, np.concatenate([each.values for each in alone]))
    strings = np.concatenate([each.strings for each in alone])
    assert np.array_equal(together.strings, strings, equal_nan=True)
    assert len(stored_samples(files[0]).rows) == sum(samples)
    assert len(stored_samples(files[1]).rows) == samples[1]


def test_files_with_one_seed_or_another_question_are_refused(seeds, three):
    twice = [read_campaign(seeds[0]) for _ in range(2)]
    with pytest.raises(PoolingError, match="has the seed of"):
        pooled(twice)
    done = report(seeds[0], three.path, "--posterior")
    assert done.exit_code == 2
    assert "is of another question" in done.stderr
    assert "objective.law" in done.stderr or "data." in done.stderr


def test_a_comparison_shows_the_values_of_the_variables(seeds):
    done = report(*seeds)
    assert done.exit_code == 0
    best = [json.loads(report(path, "--json").stdout)["best"][0] for path in seeds]
    assert "relative speed" in done.stdout.splitlines()[0]
    assert "volume fraction" in done.stdout.splitlines()[0]
    for entry in best:
        assert f"{entry['relative_speed']:.5g}" in done.stdout
