"""Collisions counted by mass: sums, rates of kinetic theory, sticking, and refusals."""

import csv
import json
import math

import numpy as np
import pytest
from click.testing import CliRunner
from plain_python import PLAIN
from scipy.io import netcdf_file

from agglom_mpi import load_campaign
from agglom_mpi.analysis.collision_kernels import (
    BlockSums,
    CollisionKernels,
)
from agglom_mpi.analysis.counted_samples import collision_kernels
from agglom_mpi.cli import main
from agglom_mpi.config.yaml_source import CampaignError
from agglom_mpi.errors import FAILURE, UserError
from agglom_mpi.outcome import FailureReason
from agglom_mpi.report.kernel_table import KernelRequest, kernel_json, kernel_text, string_kernels
from agglom_mpi.simulation.collision_counts import (
    BREAKS,
    ENERGY,
    HITS,
    LOST,
    MASS,
    NUMBER,
    STICKS,
    new_collision_counts,
)
from agglom_mpi.simulation.sample import count_collisions
from agglom_mpi.verbs.simulate import random_numbers

GAS = """\
scene: {particles: 1000, velocities: {law: spread, mean: [0, 0, 0], transverse: 1}, heating: none,
  SCENE, end_time: END}
variables: {relative_speed: 1, volume_fraction: FRACTION, density: 2500}
"""
REACTING = """\
scene:
  {particles: 30, grain_radius: 1 um, heating: none, end_time: 40 us,
   velocities: {law: spread, mean: [0, 0, 0], transverse: 1},
   fragmentation: {law: contact_breaking, youngs_modulus: 70 GPa},
   restitution: {law: adhesive, dry: {law: constant, value: 0.5}, youngs_modulus: 70 GPa}}
variables: {relative_speed: 3, volume_fraction: 0.1, density: 2500, surface_energy: 0.2}
"""


def gas(folder, scene, fraction, end, surface_energy=None):
    path = folder / "gas.yaml"
    text = GAS.replace("SCENE", scene).replace("FRACTION", str(fraction)).replace("END", end)
    if surface_energy is not None:
        text = text.replace("2500}", f"2500, surface_energy: {surface_energy}}}")
    path.write_text(text)
    return load_campaign(path)


def small(folder, scene="grain_radius: 1 mm", end="20 ms"):
    path = folder / "gas.yaml"
    elastic = f"{scene}, restitution: {{law: constant, value: 0.8}}"
    text = GAS.replace("SCENE", elastic).replace("FRACTION", "0.1").replace("END", end)
    path.write_text(text.replace("1000", "20"))
    return load_campaign(path)


@PLAIN
def test_counts_are_those_of_the_samples_and_exposures_their_integrals(tmp_path):
    (tmp_path / "reacting.yaml").write_text(REACTING)
    campaign, end = load_campaign(tmp_path / "reacting.yaml"), 40e-6
    string, times = campaign.parameters(), np.array([0.0, 8e-6, 20e-6, end])
    found = collision_kernels(campaign, string, samples=3, times=times[1:-1])
    outcomes = [campaign.simulate(string, sample, frames=times) for sample in range(3)]
    sums, impacts = found.sums, found.sums.impacts.sum(axis=(1, 2, 3))
    assert impacts[:, HITS].tolist() == [each.collisions for each in outcomes]
    assert impacts[:, STICKS].tolist() == [each.merges for each in outcomes]
    assert 0 < impacts[:, BREAKS].sum() <= sum(each.breakups for each in outcomes)
    frames = [each.frames for each in outcomes]
    energies = np.array([[kinetic_energy(each, f) for f in range(4)] for each in frames])
    lost = sums.impacts[..., LOST].sum(axis=(2, 3))
    assert lost == pytest.approx(-np.diff(energies, axis=1))
    masses = np.nansum(frames[0].masses[0]) * np.diff(times)
    assert sums.exposure[..., MASS].sum(axis=2) == pytest.approx(np.tile(masses, (3, 1)))
    held = sums.exposure[..., ENERGY].sum(axis=2) / np.diff(times)
    assert np.all(energies[:, 1:] <= held)
    assert np.all(held <= energies[:, :-1])
    number = sums.exposure[..., NUMBER].sum(axis=2)
    assert np.all(number >= np.diff(times))  # one particle at least
    assert sums.pairs.sum(axis=(2, 3)).max() < 435.0 * end


def kinetic_energy(frames, f):
    """Kinetic energy of a frame in J, in the centre-of-mass frame."""
    there = np.isfinite(frames.masses[f])
    masses, velocities = frames.masses[f, there], frames.velocities[f, there]
    motion = velocities - masses @ velocities / masses.sum()
    return 0.5 * float(masses @ np.sum(motion**2, axis=1))


@PLAIN
def test_counting_changes_no_bit_of_a_sample(tmp_path):
    campaign = small(tmp_path)
    scene = campaign.at(campaign.parameters()).build(campaign.engine(None))
    counts = new_collision_counts(scene.mass, 12, 20, np.array([scene.end_time]))
    random = random_numbers(campaign, campaign.parameters(), 5)
    assert count_collisions(scene, random, counts, np.zeros(1, np.uint8)) is None
    outcome = campaign.simulate(campaign.parameters(), 5)
    hits = int(counts.impacts[..., HITS].sum())
    assert hits == outcome.collisions
    energy = kinetic_energy(campaign.simulate(campaign.parameters(), 5, frames=2).frames, 1)
    assert counts.present[:, ENERGY].sum() == pytest.approx(energy, rel=1e-12)


def test_errors_are_those_of_a_mean_where_all_blocks_have_as_many_pairs():
    random = np.random.default_rng(2)
    impacts = np.zeros((20, 1, 1, 1, 8))
    impacts[..., HITS] = random.poisson(400.0, (20, 1, 1, 1))
    pairs, exposure = np.full((20, 1, 1, 1), 5.0), np.ones((20, 1, 1, 3))
    nothing, start = np.zeros((20, 1, 1, 1)), np.ones((20, 1, 3))
    sums = BlockSums(impacts, exposure, pairs, nothing, start, np.ones(20, np.int64))
    found = CollisionKernels(sums, np.ones(1), np.array([0.0, 1.0]), 3.0, 2500.0, 1.0)
    rates = 3.0 * impacts[:, 0, 0, 0, HITS] / 5.0
    assert found.rate.value[0, 0, 0] == pytest.approx(rates.mean())
    assert found.rate.error[0, 0, 0] == pytest.approx(rates.std(ddof=1) / math.sqrt(20))
    [record] = found.records()
    assert record["collisions"] == impacts[..., HITS].sum()
    impacts[..., HITS] = 1.0
    few = CollisionKernels(sums, np.ones(1), np.array([0.0, 1.0]), 3.0, 2500.0, 1.0)
    assert few.records() == []


def drawn_sums(means, seed=2, blocks=20):
    """Sums with Poisson numbers of collisions in one window; all bins are alike."""
    bins = len(means)
    impacts = np.zeros((blocks, 1, bins, bins, 8))
    random = np.random.default_rng(seed)
    impacts[:, 0, :, :, HITS] = random.poisson(np.triu(means) / blocks, (blocks, bins, bins))
    impacts[..., STICKS] = random.binomial(impacts[..., HITS].astype(int), 0.5)
    pairs = np.broadcast_to(np.triu(np.maximum(means, 1e-9)), (blocks, 1, bins, bins)).copy()
    exposure, start = np.ones((blocks, 1, bins, 3)), np.full((blocks, bins, 3), 1e4)
    pieces = np.zeros((blocks, 1, bins, bins))
    return BlockSums(impacts, exposure, pairs, pieces, start, np.ones(blocks, np.int64))


def kernels_of(sums, max_error=0.2, per_decade=4):
    masses = 10.0 ** (np.arange(sums.start.shape[1]) / per_decade)
    times = np.array([0.0, 1.0])
    return CollisionKernels(sums, masses, times, 3.0, 2500.0, 1.0, max_error=max_error)


def test_pairs_with_few_collisions_are_merged_until_the_error_is_small_or_left_out():
    means = np.full((12, 12), 4000.0)
    means[4:8, 4:8] = 20.0  # a square of four by four has enough, one of two by two has not
    means[8:, 8:] = 0.5
    found = kernels_of(drawn_sums(means))
    groups, hits = found.groups[0], found.hits[0]
    alone = np.triu(np.ones((12, 12), bool))
    alone[4:, 4:] = False
    assert len(set(groups[alone])) == alone.sum()
    merged = np.triu(np.ones((12, 12), bool))
    merged[:4], merged[:, 8:] = False, False
    assert np.all(groups[merged] >= 0)
    assert 1 <= len(set(groups[merged])) < merged.sum()
    assert np.all(groups[8:, 8:] == -1)
    assert np.all(np.isnan(found.rate.value[0, 8:, 8:]))
    value, error = (each[0] for each in found.efficiency)
    assert np.nanmax(error / value) <= 0.2
    one = groups == groups[4, 7]
    sticks = found.sums.impacts[:, 0, ..., STICKS].sum(axis=0)
    assert found.sticking.value[0, 4, 7] == pytest.approx(sticks[one].sum() / hits[one].sum())
    records = {(r["first_mass"], r["second_mass"]): r for r in found.records()}
    assert len(records) == np.count_nonzero(groups >= 0)
    record = records[found.masses[4], found.masses[7]]
    assert record["collisions"] == hits[4, 7]
    assert record["merged_collisions"] == hits[one].sum()
    stricter = kernels_of(found.sums, 0.05)
    assert np.nanmax(stricter.efficiency.error / stricter.efficiency.value) <= 0.05


def test_pieces_have_shares_that_add_up_to_one_where_there_are_enough():
    sums = drawn_sums(np.full((3, 3), 4000.0))
    sums.pieces[:, 0, 2, :2] = np.random.default_rng(4).poisson((30.0, 10.0), (20, 2))
    sums.pieces[0, 0, 1, 0] = 2.0
    found = kernels_of(sums)
    records = found.piece_records()
    assert [r["piece_mass"] for r in records] == found.masses[:2].tolist()
    assert {r["broken_mass"] for r in records} == {found.masses[2]}
    assert sum(r["share"][0] for r in records) == pytest.approx(1.0)
    assert records[0]["pieces"] == sums.pieces[:, 0, 2, 0].sum()
    share, error = records[0]["share"]
    assert share == pytest.approx(0.75, abs=4.5 * error)
    assert 0.0 < error < 0.1


def test_growth_in_a_window_is_what_sticking_makes_of_the_number():
    sums = drawn_sums(np.full((3, 3), 4000.0))
    start = sums.start[..., NUMBER].sum()
    left = start - sums.impacts[..., STICKS].sum()
    assert kernels_of(sums).growth == pytest.approx([start / left])


def test_kernels_whose_equations_cannot_be_integrated_are_shown_all_the_same(monkeypatch):
    found = kernels_of(drawn_sums(np.full((3, 3), 4000.0)))

    def failing(self):
        raise RuntimeError("cannot be integrated")

    monkeypatch.setattr(CollisionKernels, "balance", failing)
    assert len(json.loads(kernel_json(found))["kernels"]) == 6
    assert json.loads(kernel_json(found))["balance"] == []
    assert "cannot be integrated; divide" in str(kernel_text(found).renderables[-1])


@PLAIN
def test_samples_are_numbered_as_the_recorded_ones_of_a_string(tmp_path, monkeypatch):
    campaign = small(tmp_path)
    string = campaign.parameters()
    chosen = campaign, string, 7, None, 0
    monkeypatch.setattr("agglom_mpi.report.kernel_table.selected_string", lambda *_: chosen)
    options = {"string": None, "times": (), "csv": None, "netcdf": None, "allow_code": False}
    request = KernelRequest(tmp_path / "gas.yaml", {}, samples=3, bins=4, error=0.2, **options)
    found = string_kernels(request, print)
    expected = [campaign.simulate(string, sample).collisions for sample in (7, 8, 9)]
    assert found.sums.impacts[..., HITS].sum(axis=(1, 2, 3)).tolist() == expected


@PLAIN
def test_tables_as_json_and_csv_hold_all_pairs_and_replace_no_file(tmp_path):
    small(tmp_path)
    options = {"string": None, "times": (), "csv": tmp_path / "k.csv", "allow_code": False}
    options |= {"error": 0.2, "netcdf": tmp_path / "k.nc"}
    request = KernelRequest(tmp_path / "gas.yaml", {}, samples=3, bins=4, **options)
    found = string_kernels(request, print)
    [record] = json.loads(kernel_json(found))["kernels"]
    [row] = csv.DictReader((tmp_path / "k.csv").read_text().splitlines())
    assert float(row["rate (m^3/s)"]) == record["rate"] == found.rate.value[0, 0, 0]
    assert float(row["efficiency_error"]) == record["efficiency_error"]
    assert record["first_mass"] == pytest.approx(4.0 / 3.0 * math.pi * 1e-9 * 2500.0)
    words = ["kernels", str(tmp_path / "gas.yaml"), "--samples", "3", "--bins", "4", "--json"]
    done = CliRunner().invoke(main, words)
    assert done.exit_code == 0
    assert json.loads(done.stdout) == json.loads(kernel_json(found))
    with netcdf_file(tmp_path / "k.nc", mmap=False) as file:
        stored = {name: np.array(each[...]) for name, each in file.variables.items()}
        assert file.variables["rate"].units == b"m^3/s"
    assert stored["rate"][0, 0, 0] == record["rate"]
    assert stored["rate_error"][0, 0, 0] == record["rate_error"]
    assert stored["start_particles"].sum() == pytest.approx(20.0)
    assert stored["mean_particles"] == found.means.value[:, 0]
    for name in ("rate", "collisions", "sticking"):
        assert np.array_equal(stored[name][0], stored[name][0].T, equal_nan=True)
    with pytest.raises(FileExistsError):
        string_kernels(request, print)
    with pytest.raises(FileExistsError):
        string_kernels(request._replace(csv=None), print)


@pytest.mark.slow
@pytest.mark.parametrize("fraction", [0.05, 0.1])
def test_elastic_grains_of_two_sizes_in_equilibrium_collide_as_in_enskogs_theory(
    tmp_path, fraction
):
    """Within 1 %, and 4.5 standard errors."""
    sizes = [*[1.0] * 9, 3.0]
    (tmp_path / "two.csv").write_text("\n".join(["diameter (mm)", *map(str, sizes)]))
    scene = "sizes: {law: file, file: two.csv}, restitution: {law: constant, value: 1}"
    campaign = gas(tmp_path, scene, fraction, "300 ms")
    # The large grains, as fast as the others at first, take some 100 ms to cool.
    found = collision_kernels(campaign, campaign.parameters(), samples=40, times=[0.2])
    present = np.flatnonzero(found.numbers[1])
    assert len(present) == 2
    for i, j in ((0, 0), (0, 1), (1, 1)):
        value, error = (each[1, present[i], present[j]] for each in found.efficiency)
        assert value == pytest.approx(1.0, abs=0.01 + 4.5 * error)
    small_one, large = found.temperatures[1, present]
    assert large == pytest.approx(small_one, rel=0.1)


MAXWELLIAN = """\
from agglom_mpi.components import Velocities


class Maxwellian(Velocities):
    \"""Components are normal, with the standard deviation v0.\"""

    summary = "Maxwellian"

    def draw_velocities(self, random, velocity):
        \"""Draw x, y and z of each grain.\"""
        for i in range(velocity.shape[1]):
            for axis in range(3):
                velocity[axis, i] = self.relative_speed * random.standard_normal()

    def variance(self, speed):
        \"""Three components.\"""
        return 3.0 * speed**2

    def fastest_approach(self, speed):
        \"""Practically the highest.\"""
        return 14.0 * speed
"""
UNITS = {"adhesive": 1e-6, "wet": 1e-3}
GRAINS = {
    name: [4.0 / 3.0 * math.pi * 2500.0 * (k * unit) ** 3 for k in (1, 2)]
    for name, unit in UNITS.items()
}
SPEED = {"adhesive": 0.25, "wet": 0.15}
STICKY = {
    "adhesive": (
        "um",
        "{law: adhesive, dry: {law: constant, value: 0.9}, youngs_modulus: 70 GPa}",
        0.2,
        "10 us",
    ),
    "wet": (
        "mm",
        "{law: wet, dry: {law: constant, value: 0.9}, film_thickness: 20 um, roughness: 1 um, "
        "viscosity: 100 mPa*s}",
        None,
        "15 ms",
    ),
}


def sticking_speed(name, *pair):
    """Speed in m/s up to which grains with radii of 1 (0) and 2 (1) units stick."""
    unit = UNITS[name]
    radii, masses = [(1.0 + k) * unit for k in pair], [GRAINS[name][k] for k in pair]
    radius, mass = 1.0 / sum(1.0 / r for r in radii), 1.0 / sum(1.0 / m for m in masses)
    if name == "wet":
        return math.log(40.0) * 6.0 * math.pi * 0.1 * radius**2 / mass
    modulus = 70e9 / (2.0 * (1.0 - 0.3**2))
    work = 7.092195971863959 * (0.4**5 * radius**4 / modulus**2) ** (1.0 / 3.0)
    return math.sqrt(2.0 * work / mass) / 0.9


@pytest.mark.slow
@pytest.mark.parametrize("name", STICKY)
def test_maxwellian_grains_stick_as_often_as_the_integral_of_the_law_says(tmp_path, name):
    """1 − exp(−w²/2s²) with the law's sticking speed w; of equal and unequal grains."""
    unit, law, energy, end = STICKY[name]
    (tmp_path / "maxwell.py").write_text(MAXWELLIAN)
    (tmp_path / "two.csv").write_text(f"diameter ({unit})\n2\n4\n")
    sizes = f"sizes: {{law: file, file: two.csv}}, restitution: {law}"
    gas(tmp_path, sizes, 0.01, end, energy)
    path = tmp_path / "gas.yaml"
    spread, own = "law: spread, mean: [0, 0, 0], transverse: 1", "law: 'maxwell.py:Maxwellian'"
    text = path.read_text().replace(spread, own)
    path.write_text(text.replace("relative_speed: 1,", f"relative_speed: {SPEED[name]},"))
    campaign = load_campaign(path, allow_code=True)
    found = collision_kernels(campaign, campaign.parameters(), samples=300)
    bins = np.flatnonzero(found.numbers[0] > 10.0)
    for i, j in ((0, 0), (0, 1), (1, 1)):
        place = 0, bins[i], bins[j]
        value, error = (each[place] for each in found.sticking)
        variance = sum(found.temperatures[0, bins[k]] / GRAINS[name][k] for k in (i, j))
        expected = -math.expm1(-(sticking_speed(name, i, j) ** 2) / (2.0 * variance))
        assert 0.05 < expected < 0.95
        assert found.sticking_by_law[place] == pytest.approx(expected, rel=1e-9)
        assert value == pytest.approx(expected, abs=4.5 * error + 0.005)


@pytest.mark.parametrize("times", [[0.03], [0.0], [0.01, 0.005]])
def test_windows_beyond_the_sample_are_refused(tmp_path, times):
    campaign = small(tmp_path)
    with pytest.raises(CampaignError) as error:
        collision_kernels(campaign, campaign.parameters(), times=times)
    assert "times" in str(error.value)


def test_samples_that_all_fail_are_one_message(tmp_path, monkeypatch):
    campaign = small(tmp_path)
    module = "agglom_mpi.analysis.counted_samples"
    failed = FailureReason.PLACEMENT_JAMMED
    monkeypatch.setattr(f"{module}.count_collisions", lambda *arguments: failed)
    monkeypatch.setattr(f"{module}.ensure_counting_compiled", lambda scene: None)
    with pytest.raises(UserError) as error:
        collision_kernels(campaign, campaign.parameters(), samples=3)
    assert error.value.exit_code == FAILURE
    assert "\n" not in str(error.value)


def test_a_sheared_box_is_refused(tmp_path):
    campaign = small(tmp_path, "grain_radius: 1 mm, escape: {law: shear, rate: 10}")
    with pytest.raises(CampaignError) as error:
        collision_kernels(campaign, campaign.parameters())
    assert "scene.escape" in str(error.value)
