"""Homogeneous cooling of rough spheres: theory for equal grains, and samples to compare with.

M. Huthmann and A. Zippelius, Phys. Rev. E 56 (1997) R6275: Maxwellian velocities and spins, and
sticking contacts (μ → ∞). Derived here for solid spheres, I = q mb² with q = 2/5. Of a pair that
collides the flux-weighted ⟨w²⟩ is 4T/m, ⟨u_t²⟩ is 4T/m, and the slip by both spins has 4R/(qm), R
the rotational temperature. The impulse P = mηg_t, η = q(1 + β₀)/(2(1 + q)), changes

    E_translation by −4(A T − B R),   A = (1 − e²)/4 + η(1 − η),   B = η²/q,
    E_rotation    by  4(B T − C R),   C = (η/q)(1 − η/q),

so that dT/dt = (4/3)ω(−A T + B R) and dR/dt = (4/3)ω(B T − C R), ω the collisions per grain and s.

A. Santos, G. M. Kremer and M. dos Santos, Phys. Fluids 23 (2011) 030604, expand the distribution of
velocities c and spins w in thermal units about Maxwellians,

    1 + a₂₀ S₂(c²) + a₀₂ S₂(w²) + a₁₁ S₁(c²) S₁(w²) + b [(c·w)² − c²w²/3],

with the Sonine polynomials S₁ and S₂, and keep what is linear in the cumulants in the rates. Their
integrals are done here by sampling pairs, by the rule of a collision alone.
"""

import math

import numpy as np
from scenes import BUDGET, CONSTANT, make_scene
from scipy.integrate import solve_ivp
from scipy.optimize import fsolve

from agglom_mpi.physics.restitution import ConstantRestitution
from agglom_mpi.physics.rough import RoughFriction
from agglom_mpi.simulation.boundary import Periodic
from agglom_mpi.simulation.engines import EventDriven
from agglom_mpi.simulation.sample import simulate_scene

Q = 0.4


def coefficients(e, tangential):
    """Return A, B and C."""
    eta = Q * (1.0 + tangential) / (2.0 * (1.0 + Q))
    return (
        (1.0 - e * e) / 4.0 + eta * (1.0 - eta),
        eta * eta / Q,
        eta / Q * (1.0 - eta / Q),
    )


def late_ratio(e, tangential):
    """Return R/T at late times of Maxwellians: B λ² + (C − A)λ − B = 0."""
    a, b, c = coefficients(e, tangential)
    half = (a - c) / (2.0 * b)
    return half + math.sqrt(half * half + 1.0)


def collision_rate(scene, temperature):
    """Return ω = 4nσ²χ√(πT/m) in 1/s by Enskog, with the contact value of Carnahan and Starling."""
    density = scene.particles / (2.0 * scene.half_width) ** 3
    fraction = density * 4.0 / 3.0 * math.pi * scene.radius**3
    contact = (1.0 - 0.5 * fraction) / (1.0 - fraction) ** 3
    speed = math.sqrt(math.pi * temperature / scene.mass)
    return 4.0 * density * (2.0 * scene.radius) ** 2 * contact * speed


def cooled(scene, e, tangential, start, times):
    """Return T and R in J at times in s, shape (2, n), from their values at the first one."""
    a, b, c = coefficients(e, tangential)

    def slope(_, state):
        rate = 4.0 / 3.0 * collision_rate(scene, state[0])
        return rate * (-a * state[0] + b * state[1]), rate * (b * state[0] - c * state[1])

    run = solve_ivp(slope, (times[0], times[-1]), start, t_eval=times, rtol=1e-10, atol=0.0)
    return run.y


def gas(e, coefficient, tangential, ratio, particles, fraction):
    """Return a scene of rough grains at a volume fraction."""
    laws = CONSTANT._replace(
        restitution=ConstantRestitution.Numbers(e),
        friction=RoughFriction.Numbers(ratio, coefficient, tangential),
    )
    size = (6.0 * fraction / math.pi) ** (1.0 / 3.0)
    engine = EventDriven.Numbers(BUDGET)
    return make_scene(laws, engine, Periodic.Numbers(), particles, size, 1.0)


def temperatures(scene, times, seeds):
    """Return T and R in J of samples at times in s, shape (samples, 2, times)."""
    found = np.empty((len(seeds), 2, len(times)))
    for s, seed in enumerate(seeds):
        for t, time in enumerate(times):
            record, grains = simulate_scene(
                scene._replace(end_time=float(time)), np.random.default_rng(seed)
            )
            assert record["state"] == 1
            n = int(grains.size[0])
            velocity = grains.velocity[:, :n]
            velocity = velocity - velocity.mean(axis=1, keepdims=True)
            inertia = Q * scene.mass * scene.radius**2
            found[s, 0, t] = scene.mass * np.mean(velocity**2)
            found[s, 1, t] = inertia * np.mean(grains.spin[:, :n] ** 2)
    return found


def invariants(c, w):
    """Return c², w² and c·w of grains, (n, 3) each."""
    return tuple(np.einsum("ij,ij->i", a, b) for a, b in ((c, c), (w, w), (c, w)))


def polynomials(c, w):
    """Return what multiplies the four cumulants, shape (4, n)."""
    cc, ww, cw = invariants(c, w)
    second = (1.875 - 2.5 * x + 0.5 * x * x for x in (cc, ww))
    return np.array([*second, (1.5 - cc) * (1.5 - ww), cw * cw - cc * ww / 3.0])


def moments(c, w):
    """Return c², w², c⁴, w⁴, c²w² and (c·w)², shape (6, n)."""
    cc, ww, cw = invariants(c, w)
    return np.array([cc, ww, cc * cc, ww * ww, cc * ww, cw * cw])


class Pairs:
    """Maxwellian pairs that meet along x, weighted by the speed of their approach."""

    def __init__(self, count, seed):
        random = np.random.default_rng(seed)
        self.c, self.w = random.normal(0.0, math.sqrt(0.5), (2, 2, count, 3))
        approach = self.c[0, :, 0] - self.c[1, :, 0]
        self.c[:, approach < 0.0] = self.c[::-1, approach < 0.0]
        self.flux = np.abs(approach) / np.abs(approach).sum()
        self.weights = sum(polynomials(c, w) for c, w in zip(self.c, self.w, strict=True))

    def rates(self, e, tangential, ratio):
        """Return rates of the six moments: of Maxwellians, (6,), and by each cumulant, (6, 4)."""
        (c, d), (w, x), scale = self.c, self.w, math.sqrt(ratio / Q)  # bω is √(R/(qT)) w
        normal = np.array([1.0, 0.0, 0.0])
        slip = c - d + scale * np.cross(w + x, normal)
        slip[:, 0] = 0.0
        eta = Q * (1.0 + tangential) / (2.0 * (1.0 + Q))
        impulse = 0.5 * (1.0 + e) * (c - d)[:, :1] * normal + eta * slip
        twist = eta * np.cross(normal, slip) / (Q * scale)
        change = moments(c - impulse, w - twist) + moments(d + impulse, x - twist)
        change -= moments(c, w) + moments(d, x)
        change *= self.flux
        return change.sum(axis=1), change @ self.weights.T

    def late_state(self, e, tangential):
        """Return R/T at late times, where moments in thermal units stay, and the cumulants."""

        def imbalance(state):
            ratio, a20, a02, a11, b = state
            constant, linear = self.rates(e, tangential, ratio)
            rate = constant + linear @ state[1:]
            cooling, slowing = rate[:2] / 1.5
            # (c·w)² is 3/4 of a Maxwellian, and (c·w)² [(c·w)² − c²w²/3] is 5/4.
            mean = 3.75 + 3.75 * a20, 3.75 + 3.75 * a02, 2.25 + 2.25 * a11
            kept = 2.0 * cooling, 2.0 * slowing, cooling + slowing
            last = rate[5] - kept[2] * (0.75 + 0.75 * a11 + 1.25 * b)
            rest = [r - k * m for r, k, m in zip(rate[2:5], kept, mean, strict=True)]
            return [cooling - slowing, *rest, last]

        return fsolve(imbalance, [late_ratio(e, tangential), 0.0, 0.0, 0.0, 0.0], xtol=1e-5)
