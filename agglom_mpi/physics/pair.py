"""Two spheres about to collide, as the scalars that impact laws need."""

import math
from typing import NamedTuple


class ContactPair(NamedTuple):
    """A pair at contact and approaching; n points from i to j, t along the slip of i against j.

    Attributes
    ----------
    approach_speed
        w = (v_i − v_j)·n > 0, m/s.
    slip_speed
        |u_t|, magnitude of the tangential relative velocity, m/s.
    mass_i, mass_j, reduced_mass
        m_i, m_j and m* = m_i m_j/(m_i + m_j), kg.
    radius
        b, the smaller of the two radii, m.
    radius_i, radius_j
        b_i and b_j, m.
    temperature_i, temperature_j
        Before the impact, K.
    normal_i, normal_j, tangent_i, tangent_j
        Components of the two velocities along n and t, m/s; frame dependent, used by `OwnEnergy`.
    time_since_impact
        Time since the last impact of either, s; inf where neither has had one.
    """

    approach_speed: float
    slip_speed: float
    mass_i: float
    mass_j: float
    reduced_mass: float
    radius: float
    radius_i: float
    radius_j: float
    temperature_i: float
    temperature_j: float
    normal_i: float
    normal_j: float
    tangent_i: float
    tangent_j: float
    time_since_impact: float = math.inf
