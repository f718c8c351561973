"""The sections on the whole method, a campaign's history and extreme scenes, on made-up samples."""

from typing import ClassVar

import numpy as np
import pytest
from accuracy_rows import made_up

from agglom_mpi.accuracy import extremes, inversion, whole_method
from agglom_mpi.accuracy.published import as_published
from agglom_mpi.accuracy.time_integration import EVENT
from agglom_mpi.accuracy.trials import with_scene
from agglom_mpi.config.campaign import load_campaign
from agglom_mpi.search.objectives import GrowthTarget


@pytest.fixture(scope="module")
def campaign():
    return load_campaign("jobs/accuracy/accretion_2003_row_1.yaml")


def test_the_published_method_is_run_where_the_scene_differs_from_it(campaign):
    trials = whole_method.trials(campaign, campaign.parameters(), 5)
    assert list(trials) == [whole_method.ITERATION, whole_method.WHOLE]
    iterated, whole = trials.values()
    assert iterated.campaign.scene.solver.law == "iteration"
    assert iterated.engine.law == "event"
    assert whole.campaign.scene == as_published(campaign.scene)
    published = with_scene(campaign, **dict(as_published(campaign.scene)))
    assert whole_method.trials(published, campaign.parameters(), 5) == {}


def test_the_bias_of_the_published_method_is_over_growth(campaign):
    shared = 2.0 + 0.1 * np.random.default_rng(1).normal(size=50)
    samples = {
        EVENT: made_up(shared),
        whole_method.ITERATION: made_up(shared - 0.1, collisions=10, capped_iterations=4),
        whole_method.WHOLE: made_up(shared, failed=[0], collisions=10),
    }
    found = whole_method.whole_method(campaign, samples)
    growth = shared.mean()
    assert found.conclusions[0].startswith("Published impact iteration, exact times: mean b/b⁰ is")
    assert f"{-10.0 / growth:+.2f} ± 0.00 %" in found.conclusions[0]
    assert any("40 % of all impacts end at the iteration's cap" in text for text in found.failures)
    assert any("1 of 50 samples failed" in text for text in found.failures)


class History:
    """What the section reads of a campaign file: three generations, two of them with one best."""

    path = type("Path", (), {"name": "made_up.h5", "__str__": lambda self: "made_up.h5"})()
    campaign_text = open("jobs/quickstart.yaml").read()  # noqa: SIM115
    max_samples = 150
    identity: ClassVar[dict] = {}

    def generation_rows(self):
        names = ("generation", "best_string", "best_objective", "best_standard_error")
        names += ("seconds", "samples_simulated")
        rows = np.zeros(3, [(name, "f8") for name in names])
        rows["generation"], rows["best_string"] = [0, 1, 2], [4, 4, 9]
        rows["best_objective"], rows["best_standard_error"] = [0.05, 0.05, 0.01], 0.02
        rows["seconds"], rows["samples_simulated"] = [1.0, 2.0, 3.0], [100, 200, 300]
        return rows

    def result_rows(self):
        rows = np.zeros(2, [("string", "i8"), ("samples_used", "i8")])
        rows["string"], rows["samples_used"] = [4, 9], [30, 40]
        return rows

    def string_rows(self):
        from agglom_mpi.variables import NAMES

        rows = np.zeros(10, [("string", "i8"), *((name, "f8") for name in NAMES)])
        rows["string"] = np.arange(10)
        rows["size_ratio"] = 0.5 + 0.01 * np.arange(10)
        return rows


def test_every_best_string_is_estimated_once_on_samples_beyond_those_of_the_search():
    trials = inversion.trials(History(), 25)
    assert list(trials) == ["string 4 again", "string 9 again"]
    assert {trial.first_sample for trial in trials.values()} == {History.max_samples}
    assert trials["string 9 again"].parameters[1] == 0.59


def test_a_lucky_string_is_told_from_a_good_one():
    random = np.random.default_rng(3)
    good, lucky = 2.0 + 0.1 * random.normal(size=(2, 400))
    lucky += 0.2
    samples = {"string 4 again": made_up(good), "string 9 again": made_up(lucky)}
    found = inversion.inversion(History(), samples)
    value, error = GrowthTarget(2.0).of_rows(made_up(lucky))
    assert (
        f"string 9, claims 0.0100 ± 0.0200 and is worth {value:.4f} ± {error:.4f}"
        in (found.conclusions[0])
    )
    assert "string 4 of generation 1 has the lowest objective" in found.conclusions[1]
    frame = found.tables[1].frame
    assert frame["estimated again"].iloc[2] == value
    assert len(found.tables[0].frame) == 2
    assert len(frame) == 3


def test_what_goes_wrong_in_an_extreme_scene_is_said(campaign):
    scenes = {"calm": campaign, "wild": campaign}
    sound = {"collisions": 10, "energy_error": 1e-13, "momentum_error": 1e-15}
    broken = made_up(
        [1.5] * 8, failed=[0], collisions=10, capped_iterations=5, energy_error=-1e-3, overlaps=3
    )
    broken["reason"][0] = 2
    broken["floored_temperatures"] = 1
    samples = {
        "calm": made_up([1.5] * 8, **sound),
        "wild": made_up([1.5] * 8, **sound),
        extremes.published_name("calm"): made_up([1.5] * 8, **sound),
        extremes.published_name("wild"): broken,
    }
    found = extremes.extremes(scenes, samples)
    assert found.conclusions[0] == "Our method is sound in 2 of 2 extreme scenes."
    assert found.conclusions[1] == "The published method is sound in 1 of 2 extreme scenes."
    assert found.failures == (
        "`wild`, published: 1 of 8 samples failed (non-finite state); 50 % of impacts unsolved; "
        "temperatures below zero; energy error 0.001; 3 overlaps.",
    )


def test_heaps_of_pieces_may_overlap_and_what_never_breaks_may_not(campaign):
    heaps = made_up([1.5] * 4, collisions=10, breakups=2, overlaps=70)
    more = made_up([1.5] * 4, collisions=10, breakups=2, overlaps=90)
    names = [extremes.published_name(name) for name in ("same", "more", "solid")]
    published = dict(zip(names, (heaps, more, heaps), strict=True))
    ours = {"same": heaps, "more": heaps, "solid": made_up([1.5] * 4, collisions=10)}
    found = extremes.extremes(dict.fromkeys(ours, campaign), ours | published)
    expected = ("`more`, published: 90 overlaps.", "`solid`, published: 70 overlaps.")
    assert found.failures == expected
    assert "in 0 scenes, temperatures go below zero in 0" in found.conclusions[2]
    assert "spheres overlap that should not in 2." in found.conclusions[2]


def test_all_samples_may_fail(campaign):
    rows = made_up([0.0] * 4, failed=range(4))
    rows["reason"] = 3
    found = extremes.extremes(
        {"calm": campaign}, {"calm": rows, extremes.published_name("calm"): rows}
    )
    assert "4 of 4 samples failed (budget of steps or events exceeded)" in found.failures[0]
    for column in found.tables[0].shown:
        assert column.text(found.tables[0].frame.iloc[0])
