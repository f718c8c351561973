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
