"""A law that breaks one property fails by this property, with the numbers at which it does."""

import math

import numpy as np
import pytest
from law_subjects import instance, subject_of

from agglom_mpi.contracts.grains import sizes_failures
from agglom_mpi.contracts.tested_laws import law_findings, properties_of
from agglom_mpi.physics.contact import CompressionRecoveryDuration
from agglom_mpi.physics.cooling import Cooling
from agglom_mpi.physics.fragmentation import FragmentCount, PairEnergyFragmentation
from agglom_mpi.physics.friction import ConstantFriction
from agglom_mpi.physics.hardness import ArrheniusHardness, Hardness
from agglom_mpi.physics.heating import OwnEnergy, PairSplit
from agglom_mpi.physics.impact_solvers import FixedPointIteration
from agglom_mpi.physics.reaction import ContactAreaReaction
from agglom_mpi.physics.restitution import PressureRestitution, Restitution, RestitutionSolution
from agglom_mpi.physics.size_distributions import LognormalDistribution
from agglom_mpi.physics.sizes import LognormalSizes
from agglom_mpi.physics.velocities import SpreadVelocities


def law(base, **attributes):
    """Return a class with a summary and some formulas, which no file can name."""
    own = {"in_files": False, "summary": "broken", "__module__": __name__, **attributes}
    return type("Broken", (base,), own)


def restitution(value):
    """Return a law of restitution by a function of the pair."""

    def solve_restitution(self, laws, pair):
        return RestitutionSolution(1.0 - value(pair), False, 0.0, False)

    return law(Restitution, solve_restitution=solve_restitution)


class NewtonCooling(Cooling):
    """θ' = −(θ − 300 K)/(100 s)."""

    in_files = False
    summary = "Newton's"
    breaks = {"units": "its numbers are in SI units"}  # noqa: RUF012

    def cooling_rate(self, temperature, surface, capacity):
        return (temperature - 300.0) / 100.0

    def exact_temperature(self, temperature, surface, capacity, time):
        return 300.0 + (temperature - 300.0) * math.exp(-time / 100.0)

    def rest_temperature(self):
        return 300.0


class Linear(Hardness):
    """H = H₀ (1 − θ/θ_m) up to a thousandth of itself; the softening rises near melting."""

    in_files = False
    summary = "linear"
    melting = 2000.0
    constants = ("K",)

    def log_hardening(self, temperature):
        return math.log(max(1.0 - temperature / 2000.0, 1e-3))

    def softening_rate(self, temperature):
        return 1.0 / (2000.0 - temperature) if temperature < 1998.0 else 0.0


def warmer(self, temperature, surface, capacity, time):
    return temperature + 1e-3 * min(time, 1e5)


def euler(self, temperature, surface, capacity, time):
    return 300.0 + (temperature - 300.0) * max(0.0, 1.0 - time / 100.0)


def faster(self, temperature, surface, capacity, time):
    return 300.0 + (temperature - 300.0) * math.exp(-time / 50.0)


BROKEN = {
    "range": restitution(lambda pair: 1.5),
    "finite": restitution(lambda pair: 0.5 / pair.slip_speed * 0.0 + 0.5),
    "symmetry": restitution(lambda pair: 0.5 * min(1.0, pair.mass_i / pair.mass_j)),
    "frame": restitution(
        lambda pair: 0.5 * abs(math.tanh((pair.normal_i + pair.normal_j) / pair.approach_speed))
    ),
    "units": restitution(lambda pair: min(1.0, pair.approach_speed**-0.25)),
    "slip": law(
        ConstantFriction,
        tangential_impulse=lambda self, pair, deficit: (
            self.friction * pair.reduced_mass * (2.0 - deficit) * pair.approach_speed
        ),
    ),
    "slopes": law(ConstantFriction, impulse_slopes=lambda self, pair, lower, upper: (0.0, 0.0)),
    "energy": law(
        PairSplit,
        impact_heats=lambda self, friction, pair, deficit: (
            (0.5 * pair.reduced_mass * pair.approach_speed**2 * deficit,) * 2
        ),
    ),
    "merges": law(PairSplit, merge_heat=lambda self, pair: 0.0),
    "heat slopes": law(
        PairSplit,
        least_heat_slopes=lambda self, friction, pair, lower, upper: (
            (pair.reduced_mass * pair.approach_speed**2,) * 2
        ),
    ),
    "linear": law(
        ContactAreaReaction, contact_heat=lambda self, area: self.reaction_heat * area**2
    ),
    "size": law(
        CompressionRecoveryDuration,
        force_scale=lambda self, pair: pair.reduced_mass * pair.approach_speed**2,
    ),
    "factor": law(
        CompressionRecoveryDuration, restitution_factor=lambda self, restitution: 2.0 - restitution
    ),
    "slope": law(
        CompressionRecoveryDuration,
        restitution_factor=lambda self, restitution: 1.0 + restitution,
        restitution_factor_slope=lambda self, deficit: deficit,
    ),
    "falls": law(
        ArrheniusHardness,
        log_hardening=lambda self, temperature: (
            -self.activation_energy / (8.314462618 * temperature)
        ),
    ),
    "derivative": law(
        ArrheniusHardness,
        softening_rate=lambda self, temperature: (
            self.activation_energy / (8.314462618 * temperature) / temperature * 1.01
        ),
    ),
    "convex": Linear,
    "root": law(ArrheniusHardness, root_is_unique=lambda self, laws, pair: True),
    "pieces": law(
        PairEnergyFragmentation,
        breakage=lambda self, pair_loss, own_change, radius, grains: FragmentCount(2, 0.0),
    ),
    "more energy": law(
        PairEnergyFragmentation,
        breakage=lambda self, pair_loss, own_change, radius, grains: (
            FragmentCount(2, 0.6 * pair_loss) if grains > 1 else FragmentCount(1, 0.0)
        ),
    ),
    "pieces by frame": law(
        PairEnergyFragmentation,
        breakage=lambda self, pair_loss, own_change, radius, grains: FragmentCount(
            2 if own_change > 0.5 * pair_loss and grains > 1 else 1, 0.0
        ),
    ),
    "bounds": law(NewtonCooling, exact_temperature=warmer),
    "interval": law(NewtonCooling, exact_temperature=euler),
    "solution": law(NewtonCooling, exact_temperature=faster),
    "variance": law(SpreadVelocities, variance=lambda self, speed: 1.4 * speed**2),
    "bounds of velocities": law(SpreadVelocities, fastest_approach=lambda self, speed: speed),
    "flow": law(SpreadVelocities, mean_flow=property(lambda self: 50.0)),
}
"""Broken laws by the property; where a name stands twice, by a description."""

PROPERTY = {
    "merges": "energy",
    "heat slopes": "slopes",
    "more energy": "energy",
    "pieces by frame": "frame",
    "bounds of velocities": "bounds",
}


@pytest.mark.parametrize("case", BROKEN)
def test_a_broken_law_fails_by_its_property_with_the_numbers(case, request):
    if case != "root":  # few points have several roots
        request.getfixturevalue("few_cases")
    found = law_findings(subject_of(BROKEN[case]))
    failed = {each.name: each for each in found if each.fails}
    name = PROPERTY.get(case, case)
    assert name in failed
    line = str(failed[name])
    assert line.startswith(f"{__name__}.{BROKEN[case].__name__}: {name}: ")
    assert "\n" not in line
    assert all(math.isfinite(value) for value in failed[name].numbers.values())


@pytest.mark.usefixtures("few_cases")
def test_only_the_broken_property_fails():
    """Of the others, those that follow from it: a restitution above 1 makes energy."""
    for case, others in (("range", {"energy"}), ("symmetry", set()), ("frame", set())):
        found = law_findings(subject_of(BROKEN[case]))
        failed = {each.name for each in found if each.fails}
        assert failed == {case} | others


@pytest.mark.usefixtures("few_cases")
def test_the_numbers_of_a_failure_are_round_and_those_that_matter():
    found = law_findings(subject_of(restitution(lambda pair: min(pair.approach_speed, 10.0) / 2.0)))
    (failed,) = (each for each in found if each.name == "range")
    [(name, value)] = failed.numbers.items()
    assert name == "approach_speed"
    assert value == float(f"{value:.2g}") > 2.0


@pytest.mark.usefixtures("few_cases")
def test_a_property_that_a_class_names_is_broken_and_not_failed():
    named = law(BROKEN["symmetry"], breaks={"symmetry": "a plate and a grain"})
    found = {each.name: each for each in law_findings(subject_of(named))}
    assert found["symmetry"].fault
    assert not [each for each in found.values() if each.fails]


class Narrow(LognormalDistribution):
    def moment(self, power):
        return 1.0 + 0.5 * (super().moment(power) - 1.0)


class Middle(LognormalDistribution):
    def quantile(self, share, by_volume=False):
        return 1.0


class Negative(LognormalDistribution):
    def draw(self, random, count):
        return super().draw(random, count) - 1.0


@pytest.mark.parametrize(
    ("distribution", "property"),
    [(Narrow, "moments"), (Middle, "quantiles"), (Negative, "positive")],
)
def test_sizes_that_are_not_as_stated_are_found(distribution, property):
    sizes = LognormalSizes(spread=1.3).model_copy()
    sizes.__dict__["size_law"] = distribution(np.log(1.3))
    assert {name for name, _ in sizes_failures(sizes, 1)} == {property}


def test_instances_have_what_they_need():
    assert instance(NewtonCooling).rest_temperature() == 300.0


def test_what_another_law_of_the_scene_breaks_is_not_asked_of_a_law_that_calls_it():
    scene = {"heating": OwnEnergy(), "solver": FixedPointIteration()}
    subject = subject_of(PressureRestitution, **scene)
    promised = {name for name, _ in properties_of(subject)}
    assert promised == {"finite", "symmetry", "units", "range", "energy"}
    for law, others in ((PressureRestitution, {}), (ConstantFriction, {"heating": OwnEnergy()})):
        promised = {name for name, _ in properties_of(subject_of(law, **others))}
        assert {"frame", "root"} <= promised
