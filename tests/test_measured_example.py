"""The example of measured data: the string that the measurements were made with fits them."""

import runpy
from pathlib import Path

import pytest

from agglom_mpi import load_campaign

FOLDER = Path(__file__).parents[1] / "jobs" / "measured"
SAMPLES = 60
UNLIKELY = 1e-4
"""The measurements are one draw: that of the truth may be off, but not by this."""


def misfit_of(string):
    campaign = load_campaign(FOLDER / "measured.yaml")
    samples = [campaign.simulate(string, 1000 + k).measured for k in range(SAMPLES)]
    return campaign.objective_at(campaign.parameters(string)).misfit(samples)


@pytest.mark.slow
def test_the_string_behind_the_measurements_fits_and_another_does_not():
    truth = runpy.run_path(str(FOLDER / "measure.py"))["TRUTH"]
    found = misfit_of(truth)
    assert found.p_value > UNLIKELY
    assert all(part.p_value > UNLIKELY for part in found.parts)
    other = misfit_of(truth | {"hardness": 4.0 * truth["hardness"]})
    assert other.p_value < UNLIKELY
    assert other.value > 10.0 * max(1.0, found.value)
