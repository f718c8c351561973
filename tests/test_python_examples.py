"""The examples in jobs/python find what they ask for."""

import runpy
import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from campaign_runs import finish
from click.testing import CliRunner

import agglom_mpi

EXAMPLES = Path(__file__).parents[1] / "jobs" / "python"


@pytest.mark.slow
def test_the_posterior_by_draws_is_that_on_a_grid():
    pytest.importorskip("emcee")
    example = runpy.run_path(str(EXAMPLES / "posterior.py"))
    draws = example["draw"](steps=60)
    assert draws.shape == (32 * 40, 2)
    axes = [np.linspace(*ends, 42)[1:-1] for ends in ((2.0, 6.0), (0.4, 0.7))]
    grid = np.stack(np.meshgrid(*axes), axis=-1).reshape(-1, 2)
    weights = np.exp(example["log_probability"](grid))
    mean = np.average(grid, axis=0, weights=weights)
    spread = np.sqrt(np.average((grid - mean) ** 2, axis=0, weights=weights))
    # Some 30 of the draws are independent: their mean has a fifth of the spread as its error.
    assert (abs(draws.mean(axis=0) - mean) < 0.6 * spread).all()
    assert (abs(np.log(draws.std(axis=0) / spread)) < 0.5).all()


@pytest.mark.slow(guard="verbs/test_simulate_many.py")
def test_optuna_comes_near_to_grains_that_double():
    pytest.importorskip("optuna")
    example = runpy.run_path(str(EXAMPLES / "minimise.py"))
    study = example["minimise"](generations=4)
    assert len(study.trials) == 32
    first = [trial.value for trial in study.trials[:8]]
    fresh = example["CAMPAIGN"].simulate_many(study.best_params, samples=200, first_sample=1000)
    assert abs(fresh.mean_radius_ratio.mean() / 2.0 - 1.0) < min(0.1, np.median(first))


DUST = """\
scene:
  {particles: 500, grain_radius: 1 um, heating: none, end_time: 400 us,
   velocities: {law: spread, mean: [0, 0, 0], transverse: 1},
   restitution: {law: adhesive, dry: {law: constant, value: 0.9}, youngs_modulus: 70 GPa}}
variables: {relative_speed: 1, volume_fraction: 0.01, density: 2500, surface_energy: 0.2}
"""


@pytest.mark.slow(guard="analysis/test_collision_kernels.py")
def test_an_exported_table_grows_grains_in_particula_as_in_the_samples(tmp_path):
    """Within 2 %, and 4.5 standard errors."""
    pytest.importorskip("particula")
    from agglom_mpi.report.kernel_table import write_netcdf

    (tmp_path / "dust.yaml").write_text(DUST)
    campaign = agglom_mpi.load_campaign(tmp_path / "dust.yaml")
    times = [3e-5, 1e-4, 2e-4]
    found = campaign.collision_kernels(campaign.parameters(), samples=60, times=times)
    write_netcdf(found, tmp_path / "kernels.nc")
    example = runpy.run_path(str(EXAMPLES / "population_balance.py"))
    table = example["read"](tmp_path / "kernels.nc")
    value, error = found.means.value[:, 0], found.means.error[:, 0]
    assert value[-1] < 210.0
    grown = example["grow"](table)
    # Of particles that stick at random, the number has a variance of some third of its mean.
    there = value / np.sqrt(3.0 * value / 500.0 * example["PARTICLES"])
    assert np.all(np.abs(grown - value) < 0.02 * value + 4.5 * np.hypot(error, there))


def test_recycled_fines_return_as_much_as_they_take():
    """Growth that does not depend on the loading has a closed form: r = f/(1 - f)."""
    example = runpy.run_path(str(EXAMPLES / "flowsheet.py"))
    known = SimpleNamespace(mean=lambda string: 1.5, deviation=lambda string: 0.1)
    for shift in (0.0, 1.0):
        recycled, growth, _ = example["steady"](known, 3.0, shift=shift)
        share = example["fines"](growth)
        assert growth == 1.5 + 0.1 * shift
        assert recycled == pytest.approx(share / (1.0 - share), abs=1e-5)
    little = SimpleNamespace(mean=lambda string: 0.1, deviation=lambda string: 0.0)
    with pytest.raises(ValueError, match="no steady state"):
        example["steady"](little, 3.0)


@pytest.mark.slow(guard="inference/test_emulator_file.py")
def test_a_flowsheet_runs_on_an_exported_emulator(tmp_path):
    from agglom_mpi.cli import main

    text = (EXAMPLES.parent / "story" / "growth_by_half.yaml").read_text()
    (tmp_path / "growth.yaml").write_text(text)
    finish(tmp_path, "growth.yaml")
    files = [str(tmp_path / name) for name in ("growth.h5", "granulator.npz", "granulator.py")]
    done = CliRunner().invoke(main, ["export", files[0], "--emulator", files[1]])
    assert done.exit_code == 0, done.output
    words = [sys.executable, EXAMPLES / "flowsheet.py", files[2]]
    printed = subprocess.run(words, capture_output=True, text=True, check=True).stdout.splitlines()
    assert len(printed) == 5
    assert "must be in 0.4 to 0.7" in printed[0]
    recycled = [float(line.split()[3]) for line in printed[2:]]
    assert recycled == sorted(recycled, reverse=True)
    emulator = agglom_mpi.load_emulator(files[1])
    found, growth, _ = runpy.run_path(str(EXAMPLES / "flowsheet.py"))["steady"](emulator, 3.0)
    assert found == pytest.approx(recycled[0], abs=1e-3)
    assert 1.0 < growth < 2.5
