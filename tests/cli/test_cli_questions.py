"""The questions in jobs/questions are answered by their commands, as their text says."""

import json
import math
import re
import shutil
from pathlib import Path

import pytest
from campaign_runs import environment, need_mpirun
from processes import HANG, program

from agglom_mpi.config.loading import load_campaign
from agglom_mpi.verbs.simulate import simulate

QUESTIONS = Path(__file__).parents[2] / "jobs" / "questions"
GRAIN = 2000.0 * math.pi / 6.0 * 1e-18
"""Mass in kg of a grain of `barrier.yaml`."""


def answered(name, folder, *labels, options=()):
    """Numbers in the rows of the table that a run prints, of each label."""
    for file in QUESTIONS.glob(f"{name}.[yp]*"):
        shutil.copy(file, folder)
    words = ["mpirun", "-n", "2", "agglom-invert", f"{name}.yaml", *options]
    with program(words, cwd=folder, env=environment(COLUMNS="160")) as process:
        printed, errors = process.communicate(timeout=4 * HANG)
    assert process.returncode == 0, errors
    rows = [line for label in labels for line in printed.splitlines() if line.startswith(label)]
    assert len(rows) == len(labels)
    return [
        [float(number) for number in re.sub("± [0-9.e+-]+", "", row.removeprefix(label)).split()]
        for label, row in zip(labels, rows, strict=True)
    ]


@pytest.mark.slow
def test_a_powder_grows_by_half_along_a_line_of_speed_and_hardness(tmp_path):
    need_mpirun()
    labels = ("volume fraction  ", "95 % from", "objective, re-estimate")
    fractions, least, estimates = answered("powder", tmp_path, *labels)
    assert fractions == [0.05]
    assert least[0] == 0.0
    assert estimates[0] < 0.02


@pytest.mark.slow
def test_a_process_stays_within_its_power(tmp_path):
    need_mpirun()
    power, means = answered("process", tmp_path, "power (W/m³)", "mean, wanted 2, re-estimate ")
    assert max(power) <= 2000.0
    # Of the three things wanted the mean is met best: within a tenth of it.
    assert means == pytest.approx([2.0] * 4, abs=0.2)


@pytest.mark.slow
def test_dust_grows_by_half_where_it_meets_often_and_sticks(tmp_path):
    need_mpirun()
    labels = ("relative speed (m/s)", "surface energy (J/m²)", "mean b/b0, re-estimate")
    speeds, energies, means = answered("dust", tmp_path, *labels)
    assert means == pytest.approx([1.5] * 4, abs=0.1)
    # Slower grains meet too seldom, and those of less surface energy bounce before they have grown.
    assert min(speeds) > 0.15
    assert min(energies) > 0.03


@pytest.mark.slow
def test_the_bouncing_barrier_of_dust_moves_with_the_surface_energy_as_jkr_theory_has_it(agglom):
    """Sticking speeds go as (γ/r)^(5/6), imposed ones as r^½: r ∝ γ^(5/8)."""
    imposed = ("--impose", 0.02, 0.5, 0.1, "--samples", 3, "--json")
    sizes = []
    for energy in (0.05, 0.3):
        words = ("kernels", QUESTIONS / "barrier.yaml", "--set", f"surface_energy={energy}")
        done = agglom(*words, *imposed)
        assert done.exit_code == 0, done.output
        shown = json.loads(done.stdout)["imposed"]
        sizes.append((shown["barrier"] / GRAIN) ** (1.0 / 3.0))
        first, *_, last = shown["growth"]
        assert first["mean_mass"] < 2.0 * GRAIN
        assert last["mean_mass_from"] < last["mean_mass"] < last["mean_mass_to"]
        assert last["mean_mass"] > shown["barrier"]
        assert (first["extrapolated"], last["extrapolated"]) == pytest.approx((0.0, 1.0), abs=0.01)
        assert shown["efficiency"] == pytest.approx(1.0, abs=0.2)
    assert sizes[1] == pytest.approx(32.7, rel=0.02)
    # The loss to viscosity helps small grains to stick, so that the power is slightly smaller.
    assert math.log(sizes[1] / sizes[0]) / math.log(6.0) == pytest.approx(0.625, rel=0.03)


@pytest.mark.slow
def test_a_powder_doubles_in_binders_beyond_a_viscosity_and_up_to_a_spread(tmp_path):
    need_mpirun()
    labels = ("restitution.viscosity (Pa·s)", "sizes.spread", "mean b/b0, re-estimate")
    viscosities, spreads, means = answered("granulation", tmp_path, *labels)
    assert means == pytest.approx([2.0] * 4, abs=0.2)
    assert min(viscosities) > 0.004
    assert max(spreads) < 1.8


@pytest.mark.slow
def test_a_powder_that_lost_half_of_its_fines_is_a_fifth_coarser_at_any_speed(tmp_path):
    need_mpirun()
    labels = ("coarsening, re-estimate ", "fines, re-estimate ", "objective, re-estimate ")
    found = answered("fines", tmp_path, *labels, options=["--allow-code"])
    for coarsening, fines, objective in zip(*found, strict=True):
        assert coarsening == pytest.approx(1.18, abs=0.05)
        assert fines == pytest.approx(0.48, abs=0.05)
        wanted = (coarsening / 1.3 - 1.0) ** 2 + (fines / 0.5 - 1.0) ** 2
        assert objective == pytest.approx(wanted, abs=3e-4)


@pytest.mark.slow(guard="runtime/test_quantity_runs.py")
def test_the_readings_of_a_powder_are_what_a_granulometer_measures(tmp_path):
    campaign = load_campaign(QUESTIONS / "fines.yaml", allow_code=True)
    outcome = simulate(campaign, {}, 0)
    radii = outcome.radii
    assert outcome.quantities["rate"] == outcome.collisions / 5e-3
    assert 1.0 < outcome.quantities["coarsening"] < (radii**4).sum() / (radii**3).sum()
    assert 0.0 <= outcome.quantities["fines"] < 1.0


def without_comment(line):
    return re.sub(r"\s+#.*", "", line)


def test_what_the_text_shows_of_the_files_is_in_them():
    text = (QUESTIONS / "README.md").read_text()
    for name, block in zip(
        ("powder", "process", "fines", "dust", "granulation", "liquid", "shear"),
        re.findall(r"```yaml\n(.*?)```", text, re.S),
        strict=True,
    ):
        lines = (QUESTIONS / f"{name}.yaml").read_text().splitlines()
        known = [without_comment(line) for line in lines]
        for line in map(without_comment, block.splitlines()):
            assert any(own.startswith(line) for own in known), line


@pytest.mark.slow
def test_a_wet_powder_is_larger_by_half_up_to_a_rate_that_rises_with_viscosity(tmp_path):
    need_mpirun()
    labels = ("escape.rate (1/s)", "restitution.viscosity (mPa·s)", "mean b/b0, re-estimate")
    rates, viscosities, means = answered("shear", tmp_path, *labels)
    assert means == pytest.approx([1.5] * 4, abs=0.15)
    for rate, viscosity in zip(rates, viscosities, strict=True):
        line = 1050.0 if viscosity < 6.0 else 1050.0 * (viscosity / 6.0) ** 0.5
        assert rate == pytest.approx(line, rel=0.35)


@pytest.mark.slow
def test_three_experiments_find_the_liquid_that_their_data_were_made_with(tmp_path):
    """The data are of 4 mPa s, 1.5 µm and 0.85, with an error each."""
    need_mpirun()
    shutil.copy(QUESTIONS / "drops.csv", tmp_path)
    labels = ("restitution.viscosity (mPa·s)", "restitution.dry.value")
    viscosities, values = answered("liquid", tmp_path, *labels)
    assert viscosities[0] == pytest.approx(4.0, rel=0.4)
    assert values[0] == pytest.approx(0.85, abs=0.05)
