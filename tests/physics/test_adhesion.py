"""Adhesion: its work by the JKR curve, sticking speeds, and rebound by integrating the contact."""

import math
from pathlib import Path

import numpy as np
import pytest
from adhesive_contacts import (
    adhesive_restitution,
    adhesive_sticking_speed,
    first_touch,
    jkr_work,
    largest_pull,
    least_overlap,
    no_force,
)
from contact_pairs import contact_pair

import agglom_mpi.physics
from agglom_mpi.config.campaign import Campaign
from agglom_mpi.physics import scales
from agglom_mpi.physics.adhesion import VISCOUS, AdhesiveRestitution, viscous_number
from agglom_mpi.physics.dry_contact import sticking_speed
from agglom_mpi.physics.elastic_contact import FIXED_DISPLACEMENT, FIXED_LOAD, separation_work
from agglom_mpi.physics.elastic_plastic import ElasticPlasticRestitution
from agglom_mpi.physics.restitution import ConstantRestitution, solve_restitution
from agglom_mpi.physics.viscoelastic import (
    MeasuredViscoelasticRestitution,
    ViscoelasticRestitution,
)

ELASTIC = ConstantRestitution(value=1.0)
SILICA = {"youngs_modulus": 54e9, "poisson_ratio": 0.17}
DRY_LAWS = [
    ELASTIC,
    ConstantRestitution(value=0.7),
    ViscoelasticRestitution(**SILICA, dissipative_constant=1e-10),
    ElasticPlasticRestitution(**SILICA, yield_pressure=5e9),
]
ENERGY = 0.025
MODULUS = 54e9 / (2.0 * (1.0 - 0.17**2))


def law_around(dry):
    return AdhesiveRestitution(dry=dry, **SILICA)


def solved(dry, pair):
    law = law_around(dry)
    return solve_restitution(law.build({"surface_energy": ENERGY}), None, pair)


def dry_deficit(dry, pair):
    return solve_restitution(dry.build({}), None, pair).deficit


def test_the_work_from_first_touch_to_separation_at_fixed_displacement_is_its_integral():
    work = jkr_work(first_touch(), least_overlap())
    assert pytest.approx(work, abs=1e-6) == FIXED_DISPLACEMENT


def test_the_work_from_zero_force_to_separation_at_fixed_load_is_its_integral():
    work = jkr_work(no_force(), largest_pull())
    assert pytest.approx(work, abs=1e-6) == FIXED_LOAD
    # As published: W₀ = 1.457 (π⁵γ⁵D²R⁴)^⅓, D = ¾/E*.
    assert pytest.approx(1.457 * (math.pi**5 * 0.75**2) ** (1.0 / 3.0), rel=4e-4) == FIXED_LOAD


def test_both_works_differ_by_the_way_from_zero_force_to_no_overlap_and_the_last_one_to_breaking():
    before = jkr_work(no_force(), first_touch())
    after = jkr_work(largest_pull(), least_overlap())
    assert pytest.approx(FIXED_LOAD - before + after, abs=1e-6) == FIXED_DISPLACEMENT


def test_the_work_scales_as_the_contact_does():
    for factor in (1e-6, 1e6):
        work = separation_work(1.0, 0.5 * factor, 1.0, 1.0)
        assert work == pytest.approx(factor ** (5.0 / 3.0), rel=1e-12)
        assert separation_work(1.0, 0.5, factor, 1.0) == pytest.approx(factor ** (4 / 3), rel=1e-12)
        assert separation_work(1.0, 0.5, 1.0, factor) == pytest.approx(
            factor ** (-2 / 3), rel=1e-12
        )


@pytest.mark.parametrize(
    ("other", "number"), [(1e12, 1.840), (1.0, 0.920)], ids=["on a wall", "of two equal spheres"]
)
def test_the_sticking_speed_is_the_known_one(other, number):
    radius, density = 5e-7, 2200.0
    pair = contact_pair(1.0, radii=(radius, other * radius), density=density)
    reduced = radius * other / (1.0 + other)
    scale = ((2.0 * ENERGY / reduced) ** 5 / (density**3 * MODULUS**2)) ** (1.0 / 6.0)
    found = sticking_speed(law_around(ELASTIC).build({"surface_energy": ENERGY}), pair)
    assert found == pytest.approx(number * scale, rel=6e-4)  # both numbers have four digits


@pytest.mark.parametrize("dry", DRY_LAWS, ids=lambda dry: dry.name)
def test_the_rebound_has_the_energy_of_the_dry_one_without_the_work(dry):
    still = contact_pair(1.0, radii=(5e-7, 2e-7))
    limit = sticking_speed(law_around(dry).build({"surface_energy": ENERGY}), still)
    bounced = 0
    for speed in limit * np.geomspace(0.1, 1e3, 50):
        pair = contact_pair(speed, radii=(5e-7, 2e-7))
        solution, e = solved(dry, pair), 1.0 - dry_deficit(dry, pair)
        assert solution.bonds == (e * speed <= limit)
        if not solution.bonds:
            bounced += 1
            lost = e * e - (1.0 - solution.deficit) ** 2
            if dry.name != "viscoelastic":
                assert lost == pytest.approx((limit / speed) ** 2, rel=1e-9, abs=1e-14)
    assert bounced > 10


SCALED = {"youngs_modulus": 2.0, "poisson_ratio": 0.0}  # E* = 1


def scaled_rebound(damping, speed, energy=0.5):
    """e of the law in units of R* = E* = Γ = m* = 1; 0 where it bonds."""
    dry = ViscoelasticRestitution(**SCALED, dissipative_constant=damping)
    law = AdhesiveRestitution(dry=dry, **SCALED)
    pair = contact_pair(speed, radii=(2.0, 2.0), density=2.0 / (4.0 / 3.0 * math.pi * 8.0))
    found = solve_restitution(law.build({"surface_energy": energy}), None, pair)
    return 1.0 - found.deficit


def scaled_sticking_speed(damping):
    """Speed up to which the law bonds, in the same units."""
    low, high = 1.0, 1e6
    while high > (1.0 + 1e-9) * low:
        middle = math.sqrt(low * high)
        low, high = (middle, high) if scaled_rebound(damping, middle) == 0.0 else (low, middle)
    return low


@pytest.mark.parametrize("damping", [0.01, 0.05, 0.3, 2.0])
def test_around_a_viscoelastic_law_rebound_is_that_of_the_integrated_contact(damping):
    limit = scaled_sticking_speed(damping)
    assert adhesive_restitution(0.99 * limit, damping) == 0.0
    assert adhesive_restitution(1.01 * limit, damping) > 0.0
    for ratio in (1.11, 3.0):
        exact = adhesive_restitution(ratio * limit, damping)
        assert abs(scaled_rebound(damping, ratio * limit) - exact) < 0.013


@pytest.mark.slow
@pytest.mark.parametrize("damping", np.geomspace(1e-3, VISCOUS, 21))
def test_over_its_range_the_fit_is_within_what_is_stated(damping):
    limit = adhesive_sticking_speed(damping, scaled_sticking_speed(damping))
    assert scaled_sticking_speed(damping) == pytest.approx(limit, rel=0.006)
    for ratio in (1.1, 1.2, 1.5, 2.0, 3.0, 5.0, 10.0, 30.0, 300.0):
        exact = adhesive_restitution(ratio * limit, damping)
        assert abs(scaled_rebound(damping, ratio * limit) - exact) < 0.013


MATERIALS = {  # radius m, E Pa, ν, density kg/m³, γ J/m², A s
    "silica dust, 1 µm": (5e-7, 54e9, 0.17, 2000.0, 0.025, 1e-10),
    "dry silica dust, 1 µm": (5e-7, 54e9, 0.17, 2000.0, 0.3, 1e-10),
    "ice dust, 1 µm": (5e-7, 7e9, 0.25, 920.0, 0.1, 1e-9),
    "polystyrene, 10 µm": (5e-6, 3.3e9, 0.33, 1050.0, 0.03, 1e-8),
    "glass beads, 100 µm": (5e-5, 63e9, 0.24, 2500.0, 0.05, 1e-8),
    "rubber granules, 1 mm": (5e-4, 5e6, 0.5, 1100.0, 0.03, 2e-5),
}
PHYSICS = Path(agglom_mpi.physics.__file__).with_name("README.md")


def in_scaled_units(radius, young, poisson, density, energy, constant):
    """Viscous number, and the unit of speed in m/s, of two equal spheres."""
    modulus, mass = young / (2.0 * (1.0 - poisson**2)), 2.0 / 3.0 * math.pi * density * radius**3
    number = viscous_number(constant, energy, 0.5 * radius, modulus, mass)
    work = separation_work(1.0, energy, 0.5 * radius, modulus)
    return number, math.sqrt(work / mass)


@pytest.mark.slow
@pytest.mark.parametrize("name", MATERIALS)
def test_the_table_of_materials_is_that_of_law_and_integrated_contact(name):
    number, unit = in_scaled_units(*MATERIALS[name])
    [row] = [line for line in PHYSICS.read_text().splitlines() if line.startswith(f"| {name} |")]
    cells = [cell.split() for cell in row.strip("| ").split("|")[1:]]
    limit = adhesive_sticking_speed(number, scaled_sticking_speed(number))
    found = [[number], [unit * limit], [unit * scaled_sticking_speed(number)]]
    for ratio in (1.2, 2.0, 10.0):
        speed = ratio * limit
        found.append([adhesive_restitution(speed, number), scaled_rebound(number, speed)])
    old = unit * elastic_limit(number)
    found.insert(3, [old])
    for printed, values in zip(cells, found, strict=True):
        assert [float(each) for each in printed] == pytest.approx(values, rel=6e-3, abs=6e-4)


def elastic_limit(number):
    """Speed at which the dry rebound has the work of separation alone, in scaled units."""
    work, (low, high) = math.sqrt(2.0 * FIXED_DISPLACEMENT), (1.0, 1e6)
    while high > (1.0 + 1e-9) * low:
        middle = math.sqrt(low * high)
        sticks = middle * scaled_rebound(number, middle, energy=0.0) < work
        low, high = (middle, high) if sticks else (low, middle)
    return low


def test_without_adhesion_or_viscosity_the_limits_are_the_dry_law_and_that_of_elastic_spheres():
    pair = contact_pair(0.4, radii=(2.0, 2.0))
    dry = ViscoelasticRestitution(**SCALED, dissipative_constant=0.3)
    law = AdhesiveRestitution(dry=dry, **SCALED)
    found = solve_restitution(law.build({"surface_energy": 0.0}), None, pair)
    assert found.deficit == pytest.approx(dry_deficit(dry, pair), rel=1e-12)
    limit = math.sqrt(2.0 * FIXED_DISPLACEMENT)
    for ratio in (1.01, 2.0, 100.0):
        assert scaled_rebound(1e-12, ratio * limit) == pytest.approx(
            math.sqrt(1.0 - ratio**-2), rel=1e-9
        )


def test_a_measured_restitution_has_the_viscous_loss_of_its_material():
    measured = contact_pair(0.7, radii=(2e-6, 2e-6), density=2200.0)
    material = DRY_LAWS[2]
    e = 1.0 - dry_deficit(material, measured)
    dry = MeasuredViscoelasticRestitution(restitution=e, speed=0.7, radius=2e-6)
    pair = contact_pair(1.0, radii=(5e-7, 2e-7), density=2200.0)
    law = law_around(dry).build({"surface_energy": ENERGY, "density": 2200.0})
    found = solve_restitution(law, None, pair)
    assert not found.bonds
    assert found.deficit == pytest.approx(solved(material, pair).deficit, rel=1e-8)


def test_an_elastic_sphere_has_the_rebound_that_thornton_and_ning_give():
    limit = sticking_speed(law_around(ELASTIC).build({"surface_energy": ENERGY}), contact_pair(1.0))
    for ratio in (1.0 + 1e-9, 1.1, 2.0, 1e4):
        found = solved(ELASTIC, contact_pair(ratio * limit)).deficit
        assert 1.0 - found == pytest.approx(math.sqrt(1.0 - ratio**-2), rel=1e-7)


def test_over_all_decades_of_speed_and_size_a_pair_sticks_below_one_speed_and_bounces_above():
    for dry in DRY_LAWS:
        for radius in np.geomspace(1e-9, 1e3, 13):
            limit = sticking_speed(
                law_around(dry).build({"surface_energy": ENERGY}),
                contact_pair(1.0, radii=(radius, radius)),
            )
            found = [
                solved(dry, contact_pair(w, radii=(radius, radius)))
                for w in limit * np.geomspace(1e-6, 1e6, 49)
            ]
            bonds = [each.bonds for each in found]
            assert bonds == sorted(bonds, reverse=True)
            assert bonds[0]
            assert all(0.0 <= each.deficit <= 1.0 for each in found)


SCENE = """
seed: 1
scene:
  particles: 100
  grain_diameter: 1 um
  velocities: {law: spread, mean: [0, 0, 0], transverse: 1}
  restitution: {law: adhesive, dry: DRY, youngs_modulus: 54 GPa, poisson_ratio: 0.17}
  heating: none
  end_time: characteristic
variables:
  relative_speed: 1 m/s
  volume_fraction: 0.05
  density: 2000
  surface_energy: 0.025
"""


def section_and_values(dry, **changes):
    text = SCENE.replace("DRY", dry)
    for old, new in changes.items():
        text = text.replace(old, new)
    campaign = Campaign.from_text(text)
    return campaign.at(campaign.parameters())


@pytest.mark.parametrize("value", [1.0, 0.5])
def test_the_critical_speed_is_the_sticking_speed_over_the_dry_restitution(value):
    section, values = section_and_values(f"{{law: constant, value: {value}}}")
    pair = scales.mean_pair(section, values, 1.0)
    limit = sticking_speed(section.restitution.build(values), pair)
    assert scales.critical_speed(section, values) == pytest.approx(limit / value, rel=1e-12)


def test_the_critical_speed_is_the_root_of_the_dry_rebound():
    section, values = section_and_values(
        "{law: viscoelastic, youngs_modulus: 54 GPa, dissipative_constant: 1 ns}"
    )
    speed = scales.critical_speed(section, values)
    pair = scales.mean_pair(section, values, speed)
    limit = sticking_speed(section.restitution.build(values), pair)
    e = 1.0 - dry_deficit(section.restitution.dry, pair)
    assert e * speed == pytest.approx(limit, rel=1e-11)
    assert e < 0.9


def test_a_characteristic_end_time_follows_from_the_critical_speed():
    section, values = section_and_values("{law: constant, value: 1}")
    speed = scales.critical_speed(section, values)
    spacing = 1e-6 / values["size_ratio"] - 1e-6
    expected = spacing / speed * math.log(0.01) / math.log(0.9)
    assert scales.end_time(section, values) == pytest.approx(expected, rel=1e-12)


def test_a_dry_law_that_bonds_above_a_pressure_gives_a_second_critical_speed():
    hard = "density: 2000\n  hardness: 1 GPa\n  temperature: 300\n  activation_energy: 0"
    section, values = section_and_values("pressure", **{"density: 2000": hard})
    speeds = section.restitution.critical_speeds(section, values)
    assert speeds.bonds_from == pytest.approx(math.sqrt(6.0 * 1e9 / 2000.0), rel=1e-12)
    assert 0.0 < speeds.sticks_to < speeds.bonds_from
    assert scales.critical_speed(section, values) == speeds.sticks_to
    laws = section.impact_laws(values)
    for factor, bonds in ((0.999, True), (1.001, False)):
        pair = scales.mean_pair(section, values, factor * speeds.sticks_to)
        found = solve_restitution(laws.restitution, laws, pair)
        assert found.bonds is bonds


def test_the_tabor_number_of_a_mean_pair_is_reported_and_doubted_below_its_range():
    section, values = section_and_values("{law: constant, value: 1}")
    tabor = (0.25e-6 * 0.05**2 / (MODULUS**2 * 0.2e-9**3)) ** (1.0 / 3.0)
    (reported,) = section.restitution.reported()
    found = reported.evaluate(section.restitution, section, values)
    assert found == pytest.approx(tabor, rel=1e-12)
    assert [path for path, _ in section.restitution.cautions(section, values)] == [
        ("youngs_modulus",)
    ]
    dry = DRY_LAWS[2].model_copy(update={"dissipative_constant": 1e-8})
    viscous = section.restitution.model_copy(update={"dry": dry})
    number, _ = in_scaled_units(5e-7, 54e9, 0.17, 2000.0, 0.025, 1e-8)
    report = next(viscous.reported())
    assert report.evaluate(viscous, section, values) == pytest.approx(number, rel=1e-12)
    assert number > VISCOUS
    assert [path for path, _ in viscous.cautions(section, values)] == [
        ("dry",),
        ("youngs_modulus",),
    ]
    soft = section.restitution.model_copy(update={"youngs_modulus": 1e6})
    assert list(soft.cautions(section, values)) == []
