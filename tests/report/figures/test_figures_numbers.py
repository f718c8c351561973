"""What the figures show is what the file says, and what can be counted by hand."""

from pathlib import Path

import numpy as np
import pytest

from agglom_mpi.analysis.ranking import rank_strings
from agglom_mpi.config.loading import load_campaign
from agglom_mpi.formatting import scaled_unit, value_with_prefix
from agglom_mpi.report import sample_particles
from agglom_mpi.report.figures import convergence, ensembles, search_space
from agglom_mpi.report.figures.utilisation import (
    busy_time,
    legs_of,
    utilisation,
    utilisation_of,
)
from agglom_mpi.report.sections.published import RESULTS, read_published
from agglom_mpi.statistics import t_95
from agglom_mpi.storage.reader import read_campaign


@pytest.fixture(scope="module")
def data(finished):
    return read_campaign(finished)


def test_the_history_is_that_of_the_generations(data):
    found = convergence.convergence_history(data)
    rows, results = data.generation_rows(), rank_strings(data).results
    assert found.generation.tolist() == [1, 2, 3]
    assert found.best.tolist() == rows["best_objective"].tolist()
    for g, row in enumerate(rows):
        top = [results[i] for i in row["population"][: row["top"]].tolist()]
        assert found.top_mean[g] == pytest.approx(np.mean([r["objective"] for r in top]), rel=1e-12)
        error = np.sqrt(sum(r["standard_error"] ** 2 for r in top)) / len(top)
        assert found.top_half_width[g] == pytest.approx(1.96 * error, rel=1e-12)
        best = results[int(row["best_string"])]
        half = t_95(int(best["samples_used"]) - 1) * best["standard_error"]
        assert found.best_half_width[g] == pytest.approx(half, rel=1e-12)


def test_a_running_objective_passes_through_what_the_search_decided(data):
    for string in rank_strings(data).order:
        result = rank_strings(data).results[string]
        estimate = ensembles.running_estimate(data, string)
        assert estimate.used == result["samples_used"] - result["failed"]
        assert estimate.objective[estimate.used - 1] == pytest.approx(
            result["objective"], rel=1e-12
        )


def test_paths_are_those_of_the_best_strings_and_stay_in_the_box(data):
    for path in search_space.variable_paths(data):
        ids = data.generation_rows()["best_string"]
        assert path.best.tolist() == [data.values([i], path.variable.name)[0] for i in ids]
        assert (path.least <= path.best).all()
        assert (path.best <= path.most).all()
        assert path.variable.lower <= path.evaluated.min()
        assert path.evaluated.max() <= path.variable.upper


def test_samples_simulated_again_are_the_recorded_ones(data):
    string = rank_strings(data).order[0]
    found = sample_particles.final_radii(data, string)
    assert "identical to the recorded ones" in found.source
    rows = sample_particles.completed_samples(data, string)
    assert (rows["sample"] >= data.fresh_from).all()
    assert found.samples == len(rows) == 12
    assert len(found.values) == rows["particles"].sum()
    away = found.values - found.values.mean()
    for order, moment in zip((2, 3, 4), found.central, strict=True):
        assert moment == pytest.approx(np.mean(away**order), rel=1e-10)


def test_frames_are_taken_of_a_sample_from_its_start_to_its_end(data):
    sample = sample_particles.frames_of(data, rank_strings(data).order[0])
    rows = data.sample_rows(sample.string)
    [row] = rows[rows["sample"] == sample.sample]
    assert sample.frames.times[0] == 0.0
    assert sample.frames.times[-1] == pytest.approx(row["end_time"], rel=1e-12)
    assert sample.frames.particles[-1] == row["particles"]
    shown = sample_particles.informative_frames(sample.frames)
    assert shown == [0, 1, 2, 3, 4, 5]


def test_frames_that_are_shown_of_many_are_where_particles_bond():
    counts = np.array([1000, 500, 100, 11, *[10] * 96])
    frames = type("Frames", (), {"particles": counts})
    shown = sample_particles.informative_frames(frames)
    assert shown[:4] == [0, 1, 2, 3]
    assert shown[-1] == 99
    assert len(shown) == sample_particles.FRAMES


def test_busy_time_is_the_time_in_which_work_overlaps_each_interval():
    edges = 1.7e9 + np.array([0.0, 1.0, 3.0, 4.0])
    begin, end = 1.7e9 + np.array([0.5, 0.0, 2.0]), 1.7e9 + np.array([2.5, 1.0, 6.0])
    found = busy_time(edges, begin, end)
    np.testing.assert_allclose(found, [0.5 + 1.0, 1.5 + 1.0, 1.0], atol=1e-5)


def test_ranks_that_always_work_are_fully_utilised():
    legs = [(100.0, 200.0, 2), (500.0, 520.0, 2)]
    finished = np.concatenate([np.arange(101.0, 201.0), np.arange(501.0, 521.0)])
    both, rank = np.tile(finished, 2), np.repeat([0, 1], len(finished))
    found = utilisation(legs, both, np.ones(len(both)), rank)
    for share in (found.mean, found.least, found.most):
        np.testing.assert_allclose(share, 1.0, atol=1e-9)
    assert found.overall == pytest.approx(1.0)
    assert found.leg_boundaries == [100.0]
    assert found.edges[-1] == pytest.approx(120.0)
    half = utilisation(legs, finished, np.ones(len(finished)), np.zeros(len(finished), int))
    np.testing.assert_allclose(half.mean, 0.5, atol=1e-9)
    np.testing.assert_allclose(half.least, 0.0, atol=1e-9)


def test_a_leg_that_was_killed_lasts_until_its_last_sample():
    rows = np.array(
        [(10.0, np.nan, 2), (50.0, 60.0, 4)],
        [("started", float), ("stopped", float), ("ranks", int)],
    )
    legs = legs_of(rows, np.array([12.0, 31.0, 55.0]))
    assert legs == [(10.0, 31.0, 2), (50.0, 60.0, 4)]


def test_the_utilisation_is_that_of_the_recorded_legs(data):
    found = utilisation_of(data)
    [leg] = data.legs()
    samples = data.all_sample_rows()
    for total, each in (("busy_seconds", "seconds"), ("cpu_seconds", "cpu_seconds")):
        assert leg[total] >= (1.0 - 1e-9) * samples[each].sum() > 0.0  # some were given up
    recorded = samples["seconds"].sum() / (leg["stopped"] - leg["started"]) / leg["ranks"]
    assert found.overall == pytest.approx(recorded, rel=0.01)
    assert 0.0 < found.overall <= 1.0


def tables_of(job):
    return read_published(Path(f"jobs/published/{job}.json")).tables


def test_the_published_numbers_agree_with_each_other_as_the_paper_prints_them():
    """Π = 1 - b/b* with b* = 10 b0, and n^f = (b/b0)³; row 3 has a misprint (2.0364)."""
    rows = tables_of("agglomeration_2004")[2].rows
    results = [np.array([row[name] for row in rows]) for name in RESULTS]
    objective, ratio, number = results
    right = np.arange(6) != 2
    np.testing.assert_allclose(10.0 * (1.0 - objective[right]), ratio[right], atol=1.01e-4)
    np.testing.assert_allclose(ratio**3, number, rtol=2e-4)
    assert (np.diff(objective) > 0.0).all()


def test_the_published_strings_lie_in_the_papers_boxes():
    for job in ("accretion_2003", "agglomeration_2004"):
        identity = load_campaign(f"jobs/{job}.yaml").identity()
        for table in tables_of(job):
            for column in table.columns:
                if column.key in RESULTS:
                    continue
                low, high = (identity[f"variables.{column.key}.{end}"] for end in (0, 1))
                values = [row[column.key] for row in table.rows]
                slack = 1.0 + 1e-9
                assert low / slack <= min(values), column
                assert max(values) <= high * slack, column


@pytest.mark.parametrize(
    ("value", "said"),
    [(0.0, "0 s"), (0.0123, "12.3 ms"), (999.7, "1 ks"), (1e-6, "1 µs"), (3e-20, "3e-20 s")],
)
def test_a_quantity_has_the_prefix_that_suits_it(value, said):
    assert value_with_prefix(value, "s") == said


def test_joules_pascals_metres_and_seconds_alone_get_a_prefix():
    assert scaled_unit("m", 2e-4) == (1e-6, "µm")
    assert scaled_unit("s", 0.02) == (1e-3, "ms")
    assert scaled_unit("m/s", 1e-3) == (1.0, "m/s")
    assert scaled_unit("J/m^2", 1e7) == (1e6, "MJ/m²")
    assert scaled_unit("K", 1e7) == (1.0, "K")
    assert scaled_unit("J/mol", 1000.0) == (1.0, "J/mol")
