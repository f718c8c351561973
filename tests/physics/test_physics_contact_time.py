"""The contact time: an impact within it loses nothing, one after it is like any other."""

import math

import pytest
from contact_pairs import constant_laws, contact_pair
from hypothesis import given, settings
from hypothesis import strategies as st
from plain_python import COMPILES

from agglom_mpi.physics.friction import ConstantFriction, RestitutionScaledFriction
from agglom_mpi.physics.heating import OwnEnergy, PairSplit
from agglom_mpi.physics.reaction import ContactAreaReaction
from agglom_mpi.physics.restitution import LastingContact
from agglom_mpi.simulation.impact import solve_impact

SETTINGS = settings(max_examples=100 if COMPILES else 15, deadline=None, derandomize=True)
SPEEDS = st.floats(1e-3, 1e3)
RADII = st.tuples(st.floats(1e-4, 1e-2), st.floats(1e-4, 1e-2))
CONTACT_TIME = 1e-6
HEATINGS = pytest.mark.parametrize(
    "heating", [PairSplit.Numbers(), OwnEnergy.Numbers()], ids=["pair", "own"]
)
FRICTIONS = pytest.mark.parametrize(
    "friction",
    [None, ConstantFriction.Numbers(0.3), RestitutionScaledFriction.Numbers(0.3)],
    ids=["no", "c", "s"],
)


def plain_and_lasting(restitution, heating, friction):
    """Laws with everything that can lose or heat, without and with a contact time."""
    plain = constant_laws(restitution, heating, friction)
    plain = plain._replace(reaction=ContactAreaReaction.Numbers(1e6))
    return plain, plain._replace(restitution=LastingContact.Numbers(restitution, CONTACT_TIME))


def after(since, *pair):
    return contact_pair(*pair, frame=(3.0, -2.0))._replace(time_since_impact=since)


@HEATINGS
@FRICTIONS
@pytest.mark.parametrize("since", [0.0, 1e-12, CONTACT_TIME * (1.0 - 1e-15)])
def test_within_the_contact_time_an_impact_is_elastic_and_loses_nothing(since, friction, heating):
    @SETTINGS
    @given(SPEEDS, SPEEDS, RADII, st.floats(0.01, 1.0))
    def check(w, slip, radii, restitution):
        _, lasting = plain_and_lasting(restitution, heating, friction)
        pair = after(since, w, slip, radii)
        impact = solve_impact(lasting, pair)
        assert not impact.bonds
        assert impact.normal_impulse == 2.0 * pair.reduced_mass * w
        assert impact.friction_impulse == 0.0
        assert (impact.deficit, impact.loss) == (0.0, 0.0)
        assert (impact.heat_i, impact.heat_j, impact.reaction) == (0.0, 0.0, 0.0)
        assert (impact.residual, impact.capped) == (0.0, False)
        parted = w - impact.normal_impulse / pair.reduced_mass
        assert parted == pytest.approx(-w, rel=1e-15)

    check()


@HEATINGS
@FRICTIONS
@pytest.mark.parametrize("since", [CONTACT_TIME, 1.0, math.inf])
def test_after_the_contact_time_an_impact_is_that_of_constant_restitution(since, friction, heating):
    @SETTINGS
    @given(SPEEDS, SPEEDS, RADII, st.floats(0.01, 1.0))
    def check(w, slip, radii, restitution):
        plain, lasting = plain_and_lasting(restitution, heating, friction)
        pair = after(since, w, slip, radii)
        impact = solve_impact(lasting, pair)
        assert impact == solve_impact(plain, pair)
        assert impact.deficit == 1.0 - restitution

    check()


def test_without_a_contact_time_the_last_impact_does_not_matter():
    plain, _ = plain_and_lasting(0.5, PairSplit.Numbers(), ConstantFriction.Numbers(0.3))
    first = solve_impact(plain, after(math.inf, 2.0, 1.0))
    assert first.loss > 0.0
    assert solve_impact(plain, after(0.0, 2.0, 1.0)) == first
