"""Wet grains: the film by its equation of motion, the bridge by quadrature, and their limits."""

import math
from types import SimpleNamespace

import numpy as np
import pytest
from contact_pairs import contact_pair
from scipy.integrate import quad, solve_ivp

from agglom_mpi.config.campaign import Campaign
from agglom_mpi.physics import scales
from agglom_mpi.physics.dry_contact import sticking_speed
from agglom_mpi.physics.restitution import ConstantRestitution, solve_restitution
from agglom_mpi.physics.viscoelastic import ViscoelasticRestitution
from agglom_mpi.physics.wet import WetRestitution, bridge_work, drag_speed

FILM = {"viscosity": 1e-2, "film_thickness": 1e-5, "roughness": 1e-6}
STOKES = math.log(20.0)
"""Critical Stokes number of these."""
DRY = ConstantRestitution(value=0.8)


def solved(law, pair):
    return solve_restitution(law.build({}), None, pair)


def film_by_integration(pair, viscosity, film, roughness):
    """Speed in m/s behind the film, by integrating m*x'' = 6πηR*²x'/x from `film` to `roughness`.

    0 where the spheres stop before.
    """
    reduced = pair.radius_i * pair.radius_j / (pair.radius_i + pair.radius_j)
    drag = 6.0 * math.pi * viscosity * reduced**2 / pair.reduced_mass

    def rates(time, state):
        return -state[1], -drag * state[1] / state[0]

    def touched(time, state):
        return state[0] - roughness

    touched.terminal = True
    span = (0.0, 1e3 * film / pair.approach_speed)
    start = (film, pair.approach_speed)
    found = solve_ivp(
        rates, span, start, "LSODA", events=touched, rtol=1e-10, atol=1e-12 * film, min_step=0.0
    )
    return found.y[1, -1] if found.status == 1 else 0.0


@pytest.mark.parametrize("radii", [(1e-4, 1e-4), (1e-3, 2e-5)])
def test_the_film_takes_what_its_equation_of_motion_says(radii):
    law = WetRestitution(dry=DRY, **FILM)
    limit = STOKES * drag_speed(1e-2, contact_pair(1.0, radii=radii))
    for ratio in (1.01, 1.5, 3.0, 100.0):
        pair = contact_pair(ratio * limit, radii=radii)
        behind = film_by_integration(pair, 1e-2, 2e-5, 1e-6)
        assert 1.0 - solved(law, pair).deficit == pytest.approx(
            0.8 * behind / pair.approach_speed, rel=1e-6
        )


def test_the_stokes_number_of_equal_spheres_is_the_known_one():
    radius, density, speed = 2e-4, 2500.0, 0.3
    pair = contact_pair(speed, radii=(radius, radius), density=density)
    expected = 4.0 * density * radius * speed / (9.0 * 1e-2)
    assert speed / drag_speed(1e-2, pair) == pytest.approx(expected, rel=1e-12)


def test_a_pair_sticks_up_to_the_critical_stokes_number_and_not_above():
    law = WetRestitution(dry=DRY, **FILM)
    limit = STOKES * drag_speed(1e-2, contact_pair(1.0))
    assert sticking_speed(law.build({}), contact_pair(1.0)) == pytest.approx(limit, rel=1e-12)
    for ratio in (1e-6, 0.5, 1.0 - 1e-9):
        assert solved(law, contact_pair(ratio * limit)).bonds
    for ratio in (1.0 + 1e-9, 2.0, 1e6):
        found = solved(law, contact_pair(ratio * limit))
        assert not found.bonds
        assert 1.0 - found.deficit == pytest.approx(0.8 * (1.0 - 1.0 / ratio), rel=1e-6)


@pytest.mark.parametrize("angle", [0.0, 0.7, 1.4])
@pytest.mark.parametrize("ratio", [1e-9, 1e-4, 0.01, 0.1])
def test_the_energy_of_a_bridge_is_the_integral_of_its_force(angle, ratio):
    tension, radius = 0.072, 3e-4
    volume = ratio * radius**3

    def force(distance):
        shape = math.hypot(distance, math.sqrt(2.0 * volume / (math.pi * radius)))
        return 2.0 * math.pi * tension * radius * math.cos(angle) * (1.0 - distance / shape)

    rupture = (1.0 + 0.5 * angle) * volume ** (1.0 / 3.0)
    middle = [1e-3 * rupture, 0.1 * rupture]
    work = quad(force, 0.0, rupture, points=middle, epsabs=0.0, epsrel=1e-11)[0]
    assert bridge_work(tension, angle, ratio, radius) == pytest.approx(work, rel=1e-9)


def test_the_rebound_has_the_energy_of_the_wet_one_without_that_of_the_bridge():
    film = WetRestitution(dry=DRY, **FILM)
    law = WetRestitution(dry=DRY, **FILM, surface_tension=0.072, liquid_ratio=0.02)
    radii = (1e-4, 3e-4)
    work = bridge_work(0.072, 0.0, 0.02, 2.0 * radii[0] * radii[1] / sum(radii))
    bounced = 0
    for speed in np.geomspace(1e-6, 1e3, 60):
        pair = contact_pair(speed, radii=radii)
        wet, bridged = solved(film, pair), solved(law, pair)
        left = (1.0 - wet.deficit) ** 2 - 2.0 * work / (pair.reduced_mass * speed**2)
        assert bridged.bonds == (wet.bonds or left <= 0.0)
        if not bridged.bonds:
            bounced += 1
            assert (1.0 - bridged.deficit) ** 2 == pytest.approx(left, rel=1e-9)
    assert bounced > 10


def test_dry_grains_bounce_as_their_dry_law_has_it():
    law = WetRestitution(dry=DRY, **{**FILM, "viscosity": 0.0})
    for speed in (1e-9, 1.0, 1e3):
        found = solved(law, contact_pair(speed))
        assert not found.bonds
        assert found.deficit == pytest.approx(0.2, rel=1e-12)


def test_a_roughness_beyond_both_films_is_refused():
    with pytest.raises(ValueError, match="roughness"):
        WetRestitution(dry=DRY, **{**FILM, "roughness": 2.1e-5})


def test_over_all_decades_of_speed_and_size_a_pair_sticks_below_one_speed_and_bounces_above():
    elastic = ViscoelasticRestitution(youngs_modulus=1e9, dissipative_constant=1e-7)
    for dry in (DRY, elastic):
        law = WetRestitution(dry=dry, **FILM, surface_tension=0.03)
        for radius in np.geomspace(1e-9, 1e3, 13):
            limit = sticking_speed(law.build({}), contact_pair(1.0, radii=(radius, radius)))
            found = [
                solved(law, contact_pair(w, radii=(radius, radius)))
                for w in limit * np.geomspace(1e-6, 1e6, 49)
            ]
            bonds = [each.bonds for each in found]
            assert bonds == sorted(bonds, reverse=True)
            assert bonds[0]
            assert all(0.0 <= each.deficit <= 1.0 for each in found)


def test_the_critical_speed_and_the_stokes_number_of_a_scene_are_those_of_its_mean_pair():
    campaign = Campaign.from_text(
        """
seed: 1
scene:
  particles: 100
  grain_diameter: 200 um
  velocities: {law: spread, mean: [0, 0, 0], transverse: 1}
  restitution:
    law: wet
    dry: {law: constant, value: 0.8}
    viscosity: 10 mPa*s
    film_thickness: 10 um
    roughness: 1 um
  heating: none
  end_time: characteristic
variables: {relative_speed: 1 m/s, volume_fraction: 0.05, density: 2500}
"""
    )
    section, values = campaign.at(campaign.parameters())
    expected = 9.0 * 1e-2 * STOKES / (4.0 * 2500.0 * 1e-4)
    assert scales.critical_speed(section, values) == pytest.approx(expected, rel=1e-9)
    law = section.restitution
    found = {each.label: each.evaluate(law, section, values) for each in law.reported()}
    mean = scales.mean_approach(section, values)
    assert found["Stokes number"] == pytest.approx(mean / expected * STOKES, rel=1e-9)
    assert found["critical Stokes number"] == pytest.approx(STOKES, rel=1e-12)
    fate = next(line for line in campaign.describe().splitlines() if "mean pair  " in line)
    assert ("sticks" in fate) == (mean <= expected)
    assert f"{mean / expected:.2g}" in fate


def test_a_film_that_is_thick_for_its_grain_is_doubted():
    law = WetRestitution(dry=ConstantRestitution(value=0.8), **FILM)
    for diameter, doubted in ((1e-6, 1), (2e-4, 0)):
        scene = SimpleNamespace(diameter=diameter)
        found = [path for path, _ in law.cautions(scene, {})]
        assert found == [("film_thickness",)] * doubted
