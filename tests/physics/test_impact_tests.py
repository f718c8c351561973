"""Coefficients of single impacts by each law, against closed forms written anew."""

import math

import numpy as np
import pytest
from contact_pairs import contact_pair

from agglom_mpi.compilation.kernels import as_plain
from agglom_mpi.config.campaign import Campaign
from agglom_mpi.measurements.files.impact_file import WALL_RATIO
from agglom_mpi.simulation.impact import solve_impact, solve_impacts

DENSITY, E, NU = 2500.0, 1e9, 0.3
HERTZ = E / (2.0 * (1.0 - NU**2))
SPEEDS = np.geomspace(0.01, 10.0, 9)
PAIRS = [(1e-3, 1e-3), (1e-3, 3e-3), (1e-3, WALL_RATIO * 1e-3)]

TEXT = """
scene:
  particles: 2
  grain_radius: 1 mm
  velocities: uniform_x
  restitution: {law}
  heating: {heating}
  end_time: 1 us
variables: {{relative_speed: 1, volume_fraction: 0.01, density: 2500{variables}}}
objective: maximum_growth
"""
ELASTIC = f"youngs_modulus: {E}, poisson_ratio: {NU}"
HOT = ", hardness: 10 MPa, temperature: 300, activation_energy: 4000, heat_capacity: 700"


def laws_of(law, variables="", heating="none"):
    text = TEXT.format(law=law, variables=variables, heating=heating)
    campaign = Campaign.from_text(text)
    return campaign.impact_tests_at(campaign.parameters())


def impacts(radii, speeds=SPEEDS, temperature=math.nan):
    return np.array([[speed, *radii, temperature] for speed in speeds])


def reduced(radii):
    """Return R* and m* of two spheres."""
    masses = [DENSITY * 4.0 / 3.0 * math.pi * r**3 for r in radii]
    return 1.0 / sum(1.0 / r for r in radii), 1.0 / sum(1.0 / m for m in masses)


def elastic_plastic(w, radius, mass, p=2e7):
    """Thornton 1997 with the yield speed of ½m*w² = ∫F dδ up to the pressure p."""
    contact = math.pi * p * radius / (2.0 * HERTZ)
    limit = math.sqrt(16.0 / 15.0 * HERTZ * contact**5 / (radius**2 * mass))
    if w <= limit:
        return 1.0
    s = limit / w
    bracket = s / (s + 2.0 * math.sqrt(1.2 - 0.2 * s * s))
    return math.sqrt(6.0 * math.sqrt(3.0) / 5.0 * (1.0 - s * s / 6.0) * math.sqrt(bracket))


def viscoelastic(w, radius, mass, time=2e-6):
    beta = 1.5 * time * (4.0 / 3.0 * HERTZ * math.sqrt(radius) / mass) ** 0.4
    v = math.sqrt(beta * w**0.2)
    top = 1.0 + 0.501086 * v
    return top / (top + 1.15345 * v**2 + 0.577977 * v**3 + 0.532178 * v**4)


def adhesive(w, radius, mass, gamma=1.0, dry=0.9):
    work = 7.092195971863959 * ((2.0 * gamma) ** 5 * radius**4 / HERTZ**2) ** (1.0 / 3.0)
    return math.sqrt(max(0.0, dry**2 - 2.0 * work / (mass * w * w)))


def wet(w, radius, mass, viscosity=0.01, dry=0.9):
    stokes = mass * w / (6.0 * math.pi * viscosity * radius**2)
    return dry * max(0.0, 1.0 - math.log(2.0 * 1e-5 / 1e-6) / stokes)


CLOSED = {
    "constant": ("{law: constant, value: 0.7}", "", lambda w, radius, mass: 0.7),
    "elastic_plastic": (
        f"{{law: elastic_plastic, {ELASTIC}, yield_pressure: 20 MPa}}",
        "",
        elastic_plastic,
    ),
    "viscoelastic": (
        f"{{law: viscoelastic, {ELASTIC}, dissipative_constant: 2 us}}",
        "",
        viscoelastic,
    ),
    "adhesive": (
        f"{{law: adhesive, {ELASTIC}, dry: {{law: constant, value: 0.9}}}}",
        ", surface_energy: 1",
        adhesive,
    ),
    "wet": (
        "{law: wet, dry: {law: constant, value: 0.9}, viscosity: 10 mPa*s, film_thickness: 10 um, "
        "roughness: 1 um}",
        "",
        wet,
    ),
}


@pytest.mark.parametrize("radii", PAIRS, ids=["equal", "unequal", "wall"])
@pytest.mark.parametrize("name", CLOSED)
def test_the_coefficient_is_that_of_the_closed_form(name, radii):
    law, variables, expected = CLOSED[name]
    found = laws_of(law, variables).coefficients(impacts(radii))
    assert found == pytest.approx([expected(w, *reduced(radii)) for w in SPEEDS], rel=1e-9, abs=0)


@pytest.mark.slow
@pytest.mark.parametrize("name", [*CLOSED, "pressure"])
def test_a_kernel_returns_the_coefficients_of_plain_python(name):
    if name == "pressure":
        found = laws_of("pressure", HOT, "pair_split")
    else:
        found = laws_of(*CLOSED[name][:2])
    rows = np.concatenate([impacts(radii, temperature=350.0) for radii in PAIRS])
    compiled = found.coefficients(rows, solve_impacts)
    assert compiled == pytest.approx(found.coefficients(rows), rel=1e-10, abs=0)


@pytest.mark.parametrize("name", ["adhesive", "wet"])
def test_a_pair_that_sticks_has_a_coefficient_of_0(name):
    law, variables, _ = CLOSED[name]
    found = laws_of(law, variables).coefficients(impacts(PAIRS[0], np.geomspace(1e-4, 10.0, 40)))
    assert found[0] == 0.0
    assert found[-1] > 0.0
    assert np.all(np.diff(found) >= 0.0)


def sticking_speed(name, radii):
    """Speed of the closed forms below which a pair sticks."""
    radius, mass = reduced(radii)
    if name == "wet":
        return math.log(20.0) * 6.0 * math.pi * 0.01 * radius**2 / mass
    work = 7.092195971863959 * (2.0**5 * radius**4 / HERTZ**2) ** (1.0 / 3.0)
    return math.sqrt(2.0 * work / mass) / 0.9


@pytest.mark.parametrize("radii", PAIRS[:2], ids=["equal", "unequal"])
@pytest.mark.parametrize("name", ["adhesive", "wet"])
def test_maxwellian_grains_stick_by_the_closed_integral(name, radii):
    """∫(w/s²) exp(−w²/2s²) dw up to the sticking speed w_c: 1 − exp(−w_c²/2s²)."""
    law, variables, _ = CLOSED[name]
    limit = sticking_speed(name, radii)
    s = limit * np.array([0.05, 0.3, 1.0, 3.0, 30.0, 300.0])
    first, second = (np.full(len(s), radius) for radius in radii)
    found = laws_of(law, variables).maxwellian_sticking(first, second, s**2)
    assert found == pytest.approx(-np.expm1(-((limit / s) ** 2) / 2.0), rel=1e-8)


def test_maxwellian_grains_that_bond_by_pressure_do_so_from_a_speed_on():
    tests = laws_of("pressure", HOT, "pair_split")
    speeds = np.geomspace(10.0, 1e4, 2000)
    bonds = tests.coefficients(impacts(PAIRS[0], speeds)) == 0.0
    limit, radius = speeds[bonds].min(), np.array([1e-3])
    assert not bonds[0]
    assert bonds[-1]
    found = tests.maxwellian_sticking(radius, radius, np.array([limit**2]))
    assert found == pytest.approx([math.exp(-0.5)], rel=0.01)


def test_a_measured_restitution_is_returned_for_its_own_impact():
    law = "{law: viscoelastic_measured, restitution: 0.83, speed: 0.4 m/s, radius: 1.5 mm}"
    row = impacts((1.5e-3, 1.5e-3), [0.4])
    assert laws_of(law).coefficients(row) == pytest.approx([0.83], rel=1e-9)


@pytest.mark.parametrize("stated", [math.nan, 250.0, 400.0])
def test_the_pressure_law_has_the_root_of_the_samples_at_the_stated_temperature(stated):
    """By `solve_impact`, which the tests of the roots compare with Brent's method."""
    found = laws_of("pressure", HOT, "pair_split")
    own = 300.0 if math.isnan(stated) else stated
    for radii in PAIRS[:2]:
        coefficients = found.coefficients(impacts(radii, temperature=stated))
        for speed, coefficient in zip(SPEEDS, coefficients, strict=True):
            pair = contact_pair(speed, 0.0, radii, (own, own), DENSITY)
            impact = as_plain(solve_impact)(found.laws, pair)
            expected = 0.0 if impact.bonds else 1.0 - impact.deficit
            assert coefficient == pytest.approx(expected, rel=1e-9, abs=0)


def test_hot_pairs_lose_more_by_the_pressure_law():
    found = laws_of("pressure", HOT, "pair_split")
    cold, warm = (found.coefficients(impacts(PAIRS[0], [1.0], t)) for t in (250.0, 400.0))
    assert warm < cold
