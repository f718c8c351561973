"""Every law of the package has the properties of its kind, or says which it breaks, and does."""

import math

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from law_subjects import KEYS, subject_of

from agglom_mpi.contracts.grains import sizes_failures
from agglom_mpi.contracts.subject import Case
from agglom_mpi.contracts.tested_laws import guarded, law_findings, properties_of
from agglom_mpi.physics.hardness import ArrheniusHardness
from agglom_mpi.physics.heating import PairSplit
from agglom_mpi.physics.rough import RoughFriction
from agglom_mpi.physics.sizes import CurveSizes, FileSizes, LognormalSizes, Sizes, UniformSizes

LAWS = [law for kind in KEYS.values() for law in kind.components().values() if not law.is_absent]
SIZES = [
    LognormalSizes(spread=1.3),
    LognormalSizes(spread=3.0, median=1e-4, basis="volume"),
    UniformSizes(ratio=2.0),
    UniformSizes(ratio=10.0, basis="volume"),
    UniformSizes(smallest=1e-5, largest=3e-5),
    FileSizes._made({"file": "sieve.csv", "diameters": (1.0, 2.0, 3.0)}),
    FileSizes._made({"file": "sieve.csv", "diameters": (1.0, 2.0, 3.0), "basis": "volume"}),
    CurveSizes._made({"file": "sieve.csv", "diameters": (1.0, 2.0, 3.0), "basis": "volume"}),
]


@pytest.mark.usefixtures("few_cases")
@pytest.mark.parametrize("law", LAWS, ids=lambda law: law.__name__)
def test_a_law_has_the_properties_of_its_kind_or_breaks_those_it_names(law):
    subject = subject_of(law)
    found = law_findings(subject)
    assert {str(each) for each in found if each.fails} == set()
    assert {each.name for each in found if each.fault} == set(law.breaks)
    assert {each.name for each in found} == {name for name, _ in properties_of(subject)}


@pytest.mark.usefixtures("few_cases")
@pytest.mark.parametrize("tangential", [1.0, -0.5])
@pytest.mark.parametrize("law", [ArrheniusHardness, PairSplit])
def test_roots_and_heats_are_sound_where_a_slip_is_reversed(law, tangential):
    friction = RoughFriction(coefficient=0.5, tangential=tangential)
    found = law_findings(subject_of(law, friction=friction))
    assert {str(each) for each in found if each.fails} == set()


def numbers_in(interval):
    """Return a strategy of the numbers in an interval."""
    ends = interval.low, interval.high
    if interval.logarithmic and ends[0] < ends[1]:
        low, high = map(math.log, ends)
        plain = st.floats(low, high).map(lambda log: min(max(math.exp(log), ends[0]), ends[1]))
    else:
        plain = st.floats(*ends)
    if interval.whole:
        plain = plain.map(round).map(float)
    if interval.signed:
        plain = plain | plain.map(lambda value: -value)
    return plain | st.sampled_from(interval.special) if interval.special else plain


@pytest.mark.slow(guard="contracts/test_laws_of_the_package.py")
@pytest.mark.parametrize("law", LAWS, ids=lambda law: law.__name__)
def test_no_numbers_are_found_at_which_a_law_lacks_a_property(law):
    subject = subject_of(law)
    numbers = {name: numbers_in(interval) for name, interval in subject.intervals.items()}
    promised = [(name, check) for name, check in properties_of(subject) if name not in law.breaks]

    @settings(
        max_examples=100, deadline=None, derandomize=True, suppress_health_check=list(HealthCheck)
    )
    @given(st.fixed_dictionaries(numbers))
    def holds(drawn):
        for name, check in promised:
            assert guarded(check, Case(subject, 0, drawn)) is None, name

    holds()


@pytest.mark.parametrize("sizes", SIZES, ids=lambda sizes: sizes.summary)
def test_laws_of_sizes_have_the_moments_and_quantiles_that_they_state(sizes):
    assert list(sizes_failures(sizes, 1)) == []


def test_all_laws_of_sizes_are_among_those_tested():
    assert {type(sizes) for sizes in SIZES} == set(Sizes.components().values())
