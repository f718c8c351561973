"""The history of a campaign: what it claimed and what fresh samples say, on made-up samples."""

from typing import ClassVar

import numpy as np
from accuracy_rows import made_up

from agglom_mpi.accuracy import search_history
from agglom_mpi.search.objectives import GrowthTarget
from agglom_mpi.variables import NAMES


class History:
    """What the section reads of a campaign file: three generations, two of them with one best."""

    path = type("Path", (), {"name": "made_up.h5", "__str__": lambda self: "made_up.h5"})()
    campaign_text = open("jobs/quickstart.yaml").read()  # noqa: SIM115
    max_samples = 150
    identity: ClassVar[dict] = {}
    samples_used: ClassVar[dict] = {4: 30, 9: 40}

    def generation_rows(self):
        names = ("generation", "best_string", "best_objective", "best_standard_error")
        names += ("seconds", "samples_simulated")
        rows = np.zeros(3, [(name, "f8") for name in names])
        rows["generation"], rows["best_string"] = [0, 1, 2], [4, 4, 9]
        rows["best_objective"], rows["best_standard_error"] = [0.05, 0.05, 0.01], 0.02
        rows["seconds"], rows["samples_simulated"] = [1.0, 2.0, 3.0], [100, 200, 300]
        return rows

    def string_rows(self):
        rows = np.zeros(10, [("string", "i8"), *((name, "f8") for name in NAMES)])
        rows["string"] = np.arange(10)
        rows["size_ratio"] = 0.5 + 0.01 * np.arange(10)
        return rows


def test_every_best_string_is_estimated_once_on_samples_beyond_those_of_the_search():
    setups = search_history.setups(History(), 25)
    assert list(setups) == ["string 4 again", "string 9 again"]
    assert {setup.first_sample for setup in setups.values()} == {History.max_samples}
    assert setups["string 9 again"].parameters[1] == 0.59


def test_a_lucky_string_is_told_from_a_good_one():
    random = np.random.default_rng(3)
    good, lucky = 2.0 + 0.1 * random.normal(size=(2, 400))
    lucky += 0.2
    samples = {"string 4 again": made_up(good), "string 9 again": made_up(lucky)}
    found = search_history.search_history_section(History(), samples)
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
