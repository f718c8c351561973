"""Every law of the package has the properties of its kind, or says which it breaks, and does."""

import pytest
from law_subjects import KEYS, subject_of

from agglom_mpi.contracts.property_findings import Verdict
from agglom_mpi.contracts.starts import sizes_failures
from agglom_mpi.contracts.tested_laws import law_findings, properties_of
from agglom_mpi.physics.sizes import FileSizes, LognormalSizes, Sizes, UniformSizes

LAWS = [law for kind in KEYS.values() for law in kind.components().values() if not law.is_absent]
SIZES = [
    LognormalSizes(spread=1.3),
    LognormalSizes(spread=3.0, median=1e-4, basis="volume"),
    UniformSizes(ratio=2.0),
    UniformSizes(ratio=10.0, basis="volume"),
    UniformSizes(smallest=1e-5, largest=3e-5),
    FileSizes._made({"file": "sieve.csv", "diameters": (1.0, 2.0, 3.0)}),
    FileSizes._made({"file": "sieve.csv", "diameters": (1.0, 2.0, 3.0), "basis": "volume"}),
]


ALL = pytest.mark.slow(guard="contracts/test_laws_of_the_package.py")


@pytest.fixture(params=["few", pytest.param("all", marks=ALL)])
def points(request):
    """Test at few of the random points, slowly at all of them."""
    if request.param == "few":
        request.getfixturevalue("few_points")


@pytest.mark.usefixtures("points")
@pytest.mark.parametrize("law", LAWS, ids=lambda law: law.__name__)
def test_a_law_has_the_properties_of_its_kind_or_breaks_those_it_names(law):
    subject = subject_of(law)
    found = law_findings(subject)
    assert {str(each) for each in found if each.verdict is Verdict.FAILS} == set()
    assert {each.property for each in found if each.verdict is Verdict.BREAKS} == set(law.breaks)
    assert {each.property for each in found} == {each.name for each in properties_of(subject)}


@pytest.mark.parametrize("sizes", SIZES, ids=lambda sizes: sizes.summary)
def test_laws_of_sizes_have_the_moments_and_quantiles_that_they_state(sizes):
    assert list(sizes_failures(sizes, 1)) == []


def test_all_laws_of_sizes_are_among_those_tested():
    assert {type(sizes) for sizes in SIZES} == set(Sizes.components().values())
