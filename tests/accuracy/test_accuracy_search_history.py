"""The history of a campaign: what it claimed and what fresh samples say, on made-up samples."""

import math
from typing import ClassVar

import numpy as np
import pytest
from accuracy_rows import frame_of, made_up
from goals import growth_target
from matplotlib.figure import Figure
from measured_runs import write_measured

from agglom_mpi.accuracy.time_integration import search_history
from agglom_mpi.config.loading import load_campaign
from agglom_mpi.config.yaml_source import CampaignError
from agglom_mpi.declaration.reading import PLAIN
from agglom_mpi.variables import TEN


class History:
    """What the section reads of a campaign file: three generations, two of them with one best."""

    path = type("Path", (), {"name": "made_up.h5", "__str__": lambda self: "made_up.h5"})()
    campaign_text = open("jobs/quickstart.yaml").read()  # noqa: SIM115
    max_samples = 150
    identity: ClassVar[dict] = {}
    allow_code = False
    reading = PLAIN
    samples_used: ClassVar[dict] = {4: 30, 9: 40}

    def generation_rows(self):
        names = ("generation", "best_string", "best_objective", "best_standard_error")
        names += ("seconds", "samples_simulated")
        rows = np.zeros(3, [(name, "f8") for name in names])
        rows["generation"], rows["best_string"] = [0, 1, 2], [4, 4, 9]
        rows["best_objective"], rows["best_standard_error"] = [0.05, 0.05, 0.01], 0.02
        rows["seconds"], rows["samples_simulated"] = [1.0, 2.0, 3.0], [100, 200, 300]
        return rows

    @property
    def parameters(self):
        strings = np.zeros((10, TEN.count))
        strings[:, TEN.index("size_ratio")] = 0.5 + 0.01 * np.arange(10)
        return dict(enumerate(strings))

    def derived(self, compute):
        return compute(self)


def test_every_best_string_is_estimated_once_on_samples_beyond_those_of_the_search():
    setups = search_history.history_part(History(), 25).setups
    assert list(setups) == ["string 4 again", "string 9 again"]
    assert {setup.first_sample for setup in setups.values()} == {History.max_samples}
    assert setups["string 9 again"].parameters[1] == 0.59


def test_a_history_of_measured_data_is_refused(tmp_path, monkeypatch):
    campaign = load_campaign(write_measured(tmp_path))
    monkeypatch.setattr(search_history, "recorded_campaign", lambda history: campaign)
    with pytest.raises(CampaignError) as caught:
        search_history.history_part(History(), 25)
    [problem] = caught.value.problems
    assert problem.field == "objective.law"


def test_a_lucky_string_is_told_from_a_good_one():
    random = np.random.default_rng(3)
    good, lucky = 2.0 + 0.1 * random.normal(size=(2, 400))
    lucky += 0.2
    samples = {"string 4 again": made_up(good), "string 9 again": made_up(lucky)}
    found = search_history.history_part(History(), 25).section(samples)
    value, error = growth_target(2.0).of_rows(made_up(lucky))
    assert (
        f"string 9, claims 0.0100 ± 0.0200 and is worth {value:.4f} ± {error:.4f}"
        in (found.conclusions[0])
    )
    wanted = search_history.optimism_of(frame_of(found.tables[1]).drop_duplicates("string"))
    errors = [0.02, 0.02, *(growth_target(2.0).of_rows(made_up(r))[1] for r in (good, lucky))]
    assert wanted.error == pytest.approx(np.linalg.norm(errors) / 2)
    assert wanted.value == pytest.approx(
        np.mean([growth_target(2.0).of_rows(made_up(r))[0] for r in (good, lucky)]) - 0.03
    )
    assert "string 4 of generation 1 has the lowest objective" in found.conclusions[1]
    frame = frame_of(found.tables[1])
    assert frame["estimated again"].iloc[2] == value
    assert len(frame_of(found.tables[0])) == 2
    assert len(frame) == 3


def conclusions(shift, error=0.02):
    """Return what is said where the best strings are worth `shift` more than they claimed."""
    history = History()
    rows = history.generation_rows()
    rows["best_standard_error"] = error
    history.generation_rows = lambda: rows
    claims = {"string 4 again": 0.05, "string 9 again": 0.01}
    spread = 0.01 * np.resize([-1.0, 1.0], 400)
    samples = {name: made_up(2.0 + 2.0 * (c + shift) + spread) for name, c in claims.items()}
    return search_history.history_part(history, 25).section(samples).conclusions


@pytest.mark.parametrize(
    ("shift", "words"),
    [(0.025, "no bias is shown"), (0.035, "more on average"), (0.2, "the lucky survive")],
)
def test_a_bias_is_claimed_beyond_two_standard_errors(shift, words):
    # The error of the mean of two claims of ± 0.02 is 0.0141; that of the samples is negligible.
    assert words in conclusions(shift)[-1]
    assert ("no bias" in conclusions(shift)[-1]) == (shift < 0.0283)


def test_a_claim_of_a_single_sample_has_no_error():
    assert "claims 0.0100 and is worth 0.2100" in conclusions(0.2, math.nan)[0]
    assert "±" not in conclusions(0.2, math.nan)[0].partition(" and ")[0]


def test_bands_end_at_the_least_objective():
    samples = {f"string {i} again": made_up(2.0 + 0.1 * np.arange(-9, 10)) for i in (4, 9)}
    frame = search_history.measured_history(
        History(), search_history.recorded_campaign(History()), samples
    )
    figure = Figure()
    search_history._draw(figure, frame, 0.0)
    bands = [path for each in figure.axes[0].collections for path in each.get_paths()]
    assert len(bands) == 2
    assert min(float(path.vertices[:, 1].min()) for path in bands) == 0.0
