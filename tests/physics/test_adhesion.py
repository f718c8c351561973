"""Adhesion: its work by the JKR curve, sticking speeds, and rebound by integrating the contact."""

import math

import numpy as np
import pytest
from adhesive_contacts import first_touch, jkr_work, largest_pull, least_overlap, no_force
from contact_pairs import contact_pair

from agglom_mpi.config.campaign import Campaign
from agglom_mpi.physics import scales
from agglom_mpi.physics.adhesion import AdhesiveRestitution
from agglom_mpi.physics.dry_contact import sticking_speed
from agglom_mpi.physics.elastic_contact import FIXED_DISPLACEMENT, FIXED_LOAD, separation_work
from agglom_mpi.physics.elastic_plastic import ElasticPlasticRestitution
from agglom_mpi.physics.restitution import ConstantRestitution, solve_restitution
from agglom_mpi.physics.viscoelastic import ViscoelasticRestitution

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
            assert lost == pytest.approx((limit / speed) ** 2, rel=1e-9, abs=1e-14)
    assert bounced > 10


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
    soft = section.restitution.model_copy(update={"youngs_modulus": 1e6})
    assert list(soft.cautions(section, values)) == []
