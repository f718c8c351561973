import numpy as np
import pytest
from campaign_runs import TINY, write_campaign, write_endless

from agglom_mpi.config.loading import load_campaign
from agglom_mpi.config.yaml_source import CampaignError
from agglom_mpi.outcome import COMPLETED, FAILED
from agglom_mpi.planning import pilot
from agglom_mpi.planning.cluster_simulator import ClusterSimulator
from agglom_mpi.planning.pilot import pilot_tasks, run_pilot
from agglom_mpi.planning.plan import pilot_summary
from agglom_mpi.planning.workload import (
    LEAST_SAMPLES,
    EmpiricalWorkload,
    PilotSamples,
    read_recorded_samples,
    splitmix64,
)
from agglom_mpi.runtime.experiment import InversionExperiment
from agglom_mpi.storage.reader import read_campaign
from agglom_mpi.storage.schema import sample_dtype
from agglom_mpi.verbs.simulate import simulate


@pytest.fixture
def campaign(tmp_path):
    return load_campaign(write_campaign(tmp_path / "tiny.yaml", **TINY))


def recorded(campaign, *counts, settings=({"size_ratio": 0.4}, {"size_ratio": 0.5})):
    """So many samples of strings; their time tells which they are: 10 s · string + number."""
    rows = np.zeros(sum(counts), sample_dtype)
    rows["string"] = np.repeat(np.arange(len(counts)), counts)
    rows["sample"] = np.concatenate([np.arange(count) for count in counts])
    rows["seconds"] = rows["cpu_seconds"] = 10.0 * rows["string"] + rows["sample"]
    rows["state"] = COMPLETED
    return PilotSamples(rows, np.array([campaign.parameters(values) for values in settings]))


def times(workload, parameters, samples):
    return workload.samples(parameters, 0, samples)[1].tolist()


def test_a_recorded_string_gives_its_own_samples_first_and_then_some_of_them_again(campaign):
    known = recorded(campaign, 6, 6)
    drawn = times(EmpiricalWorkload(known, campaign), known.parameters[1], 200)
    assert drawn[:6] == [10, 11, 12, 13, 14, 15]
    assert set(drawn[6:]) == {10, 11, 12, 13, 14, 15}


def test_a_sample_takes_its_processor_time_or_else_its_wall_clock_time(campaign):
    known = recorded(campaign, 6, 6)
    known.rows["seconds"] *= 7.0  # a busy machine
    assert times(EmpiricalWorkload(known, campaign), known.parameters[1], 2) == [10, 11]
    known.rows["cpu_seconds"] = np.nan  # a file of format version 2
    assert times(EmpiricalWorkload(known, campaign), known.parameters[1], 2) == [70, 77]


def test_the_summary_of_samples_shows_a_busy_machine(campaign):
    known = recorded(campaign, 6, 6)
    summary = pilot_summary(known)
    assert (summary.mean_seconds, summary.longest_seconds) == (7.5, 15.0)
    assert summary.wall_over_cpu == 1.0
    known.rows["seconds"] *= 7.0
    busy = pilot_summary(known)
    assert (busy.mean_seconds, busy.longest_seconds) == (7.5, 15.0)
    assert busy.wall_over_cpu == 7.0
    known.rows["cpu_seconds"] = np.nan
    unknown = pilot_summary(known)
    assert (unknown.mean_seconds, unknown.longest_seconds) == (52.5, 105.0)
    assert np.isnan(unknown.wall_over_cpu)


def test_other_strings_draw_from_the_nearest(campaign):
    workload = EmpiricalWorkload(recorded(campaign, 6, 6), campaign)
    near_first, near_second = (
        times(workload, campaign.parameters({"size_ratio": ratio}), 200) for ratio in (0.44, 0.46)
    )
    assert set(near_first) == {0, 1, 2, 3, 4, 5}
    assert set(near_second) == {10, 11, 12, 13, 14, 15}
    assert near_first != [seconds - 10 for seconds in near_second]


def test_near_is_measured_in_the_box_that_is_searched(campaign):
    # A hundredth of the range of hardness, in Pa, is far more than all that of the size ratio.
    settings = ({"size_ratio": 0.4, "hardness": 50e6}, {"size_ratio": 0.8, "hardness": 52e6})
    workload = EmpiricalWorkload(recorded(campaign, 6, 6, settings=settings), campaign)
    asked = campaign.parameters({"size_ratio": 0.45, "hardness": 52e6})
    assert max(times(workload, asked, 20)) < 10


def test_draws_depend_on_string_and_sample_alone(campaign):
    known = recorded(campaign, 6, 6)
    asked = campaign.parameters({"size_ratio": 0.41})
    first, second = EmpiricalWorkload(known, campaign), EmpiricalWorkload(known, campaign)
    forward = times(first, asked, 50)
    times(second, known.parameters[1], 5)
    backward = [second.samples(asked, sample, 1)[1][0] for sample in reversed(range(50))]
    assert forward == backward[::-1]


def test_random_numbers_are_those_of_splitmix64():
    # First outputs for the seed 0, by the reference implementation.
    assert splitmix64(0, np.arange(3, dtype=np.uint64)).tolist() == [
        0xE220A8397B1DCDAF,
        0x6E789E6AA1B965F4,
        0x06C45D188009454F,
    ]


def test_draws_are_uniform(campaign):
    known = recorded(campaign, 10, settings=({},))
    n = 4000
    drawn = times(EmpiricalWorkload(known, campaign), known.parameters[0], n + 10)
    counts = np.bincount(np.array(drawn, int))
    error = np.sqrt(n * 0.1 * 0.9)
    assert np.all(np.abs(counts - 1 - n / 10) < 4 * error)


def test_a_string_with_hardly_a_sample_is_no_source_for_others(campaign):
    known = recorded(campaign, LEAST_SAMPLES, LEAST_SAMPLES - 1)
    drawn = times(EmpiricalWorkload(known, campaign), known.parameters[1], 30)
    assert drawn[: LEAST_SAMPLES - 1] == [10, 11, 12, 13]
    assert max(drawn[LEAST_SAMPLES - 1 :]) < 10
    scarce = recorded(campaign, 1, 2)
    assert set(times(EmpiricalWorkload(scarce, campaign), scarce.parameters[0], 30)[1:]) == {10, 11}


def test_samples_that_failed_fail_again(campaign):
    known = recorded(campaign, 6, 6)
    known.rows["state"][3] = FAILED
    workload = EmpiricalWorkload(known, campaign)
    rows, _ = workload.samples(known.parameters[0], 0, 6)
    assert rows["state"].tolist() == [COMPLETED] * 3 + [FAILED] + [COMPLETED] * 2


def test_a_finished_file_foretells_its_own_decisions(campaign, shared_campaign):
    path = str(shared_campaign("tiny") / "tiny.h5")
    workload = EmpiricalWorkload(read_recorded_samples(path, campaign), campaign)
    work = InversionExperiment(campaign)
    cluster = ClusterSimulator(work.inversion(None), workload, 3)
    forecast = cluster.run()
    results = read_campaign(path).result_rows()
    assert cluster.path.used == dict(results[["string", "samples_used"]].tolist())
    assert forecast.used == results["samples_used"].sum()
    assert not read_recorded_samples(path, campaign).differences


def test_a_file_of_another_scene_is_read_and_the_difference_said(campaign, shared_campaign):
    path = str(shared_campaign("tiny") / "tiny.h5")
    text = campaign.text.replace("density: 6142", "density: 7000")
    other = type(campaign).from_text(text)
    differences = read_recorded_samples(path, other).differences
    assert len(differences) == 2  # both ends of its range
    assert differences[0] == "variables.density.0 was 6142.0, is 7000.0"
    text = campaign.text.replace("density: 6142", "density: [6000, 7000]")
    with pytest.raises(CampaignError, match=r"tiny\.h5: variables: .*density"):
        read_recorded_samples(path, type(campaign).from_text(text))


def test_simulated_strings_are_those_of_the_first_generation(campaign):
    known = run_pilot(campaign, 60.0, lambda text: None)
    assert len(known.rows) == campaign.max_strings * campaign.ensemble.max_samples
    work = InversionExperiment(campaign)

    [first] = work.inversion(None).start()
    assert first.proposals.parameters.tobytes() == known.parameters[first.strings].tobytes()
    assert len(first.strings) == campaign.search.population
    row = known.rows[7]
    outcome = simulate(campaign, known.parameters[row["string"]], int(row["sample"]))
    assert outcome.mean_radius_ratio == row["mean_radius_ratio"]


def test_no_time_for_a_sample_is_a_mistake(campaign, monkeypatch):
    class OverAtOnce:
        def __init__(self, seconds, ring):
            self.start, self.cancel = ring, lambda: None

    monkeypatch.setattr(pilot, "Timer", OverAtOnce)
    with pytest.raises(CampaignError, match=r"3 s.*--seconds"):
        run_pilot(campaign, 3.0, lambda text: None)


def test_a_sample_that_takes_longer_than_the_time_there_is_is_ended(tmp_path):
    path = write_endless(tmp_path / "endless.yaml")
    path.write_text(path.read_text().replace("[10 MPa, 200 MPa]", "1e30"))
    with pytest.raises(CampaignError, match="--seconds"):
        run_pilot(load_campaign(path), 0.3, lambda text: None)


def test_strings_and_samples_grow_together_up_to_all_there_are():
    done = [0] * 13
    for string, first, count in pilot_tasks(13, 5):
        assert done[string] == first
        done[string] += count
        # No string runs ahead of one that has begun by more than a round.
        begun = [number for number in done if number]
        assert max(begun) <= 4 * len(begun)
    assert done == [5] * 13
