"""Hardness of a grain as a function of its temperature."""

import math
from collections.abc import Mapping
from typing import Any, ClassVar, Final, Literal

from agglom_mpi.compilation.stages import formula
from agglom_mpi.declaration.laws import Group, Law
from agglom_mpi.declaration.needed import needed
from agglom_mpi.physics.constants import GAS_CONSTANT
from agglom_mpi.physics.friction import keeps_loss_concave
from agglom_mpi.physics.heating import keeps_root_unique

SOFTENING: Final = Group(
    "U/(Rθ)",
    "activation energy over thermal energy",
    {"activation_energy": 1.0, "temperature": -1.0},
)

UNIQUE_HARDENING: Final = 4.0
"""U/(Rθ) of the colder sphere up to which the root is unique: heat/d falls with d, so
d|θ'| ≤ θ − θ₀ and the softening's slope is at most (U/R) max (θ−θ₀)/θ² = U/(4Rθ₀)."""


class Hardness(Law):
    """Law of the hardness H = H₀ h(θ), which falls with θ; the variable `hardness` is H₀ in Pa.

    Attributes
    ----------
    softened_by
        Variable that makes cold grains harder than H₀; None: H is constant.
    misprint
        Remark on a source that misprints the unit of that variable.
    exponent_symbol
        Symbol of ln(H/H₀) in messages.
    least_exponent
        ln(H/H₀) of the hottest grains.
    """

    variables: ClassVar[tuple[str, ...]] = ("hardness",)
    misprint: ClassVar[str] = ""
    softened_by: ClassVar[str | None] = None
    exponent_symbol: ClassVar[str] = "ln(H/H0)"
    least_exponent: ClassVar[float] = 0.0

    @needed
    def log_hardening(self, temperature: float) -> float:
        """ln(H/H₀) at `temperature` in K, dimensionless; +inf where the grain does not yield."""
        raise NotImplementedError

    @needed
    def softening_rate(self, temperature: float) -> float:
        """−d ln H/dθ in 1/K at `temperature` > 0 K; must not rise with the temperature.

        The proofs of `restitution.certified_step` rest on that.
        """
        raise NotImplementedError

    def root_is_unique(self, laws: Any, pair: Any) -> bool:
        """Whether e = G(e) is proven to have a single root for this pair of grains."""
        return False

    def exponent(self, value: Mapping[str, float]) -> float:
        """Return ln(H/H₀) of a grain at the starting temperature of a string.

        Parameters
        ----------
        value
            The variables in SI units, by name.
        """
        return log_hardening(self.build(value), value["temperature"])


class ArrheniusHardness(Hardness):
    """H = H₀ exp(U/(Rθ)); H₀ is the hot limit  [A section 4] [B section 6]."""

    law: Literal["arrhenius"] = "arrhenius"
    summary: ClassVar[str] = "falls with temperature, H0 exp(U/(R theta))"
    variables = ("hardness", "activation_energy")
    needs = ("temperature",)
    groups = (SOFTENING,)
    constants = ("J/mol/K",)
    softened_by = "activation_energy"
    misprint = "; [A] prints kJ/mol for J/mol"
    exponent_symbol = "U/(R theta)"

    def log_hardening(self, temperature):
        """U/(Rθ), dimensionless; +inf at and below 0 K if U > 0."""
        if self.activation_energy == 0.0:
            return 0.0
        if temperature <= 0.0:
            return math.inf
        return self.activation_energy / (GAS_CONSTANT * temperature)

    def softening_rate(self, temperature):
        """U/(Rθ²) in 1/K."""
        return self.activation_energy / (GAS_CONSTANT * temperature) / temperature

    def root_is_unique(self, laws, pair):
        """Where grains soften so mildly that `UNIQUE_HARDENING` holds."""
        colder = min(pair.temperature_i, pair.temperature_j)
        concave = keeps_root_unique(laws.heating) and keeps_loss_concave(laws.friction)
        return concave and log_hardening(laws.hardness, colder) <= UNIQUE_HARDENING


class ConstantHardness(Hardness):
    """H = H₀ at every temperature."""

    law: Literal["constant"] = "constant"
    summary: ClassVar[str] = "H0 at every temperature"

    def log_hardening(self, temperature):
        """0: H is H₀."""
        return 0.0

    def softening_rate(self, temperature):
        """0: H does not change."""
        return 0.0

    def root_is_unique(self, laws, pair):
        """Return True: the pressure does not fall with the deficit."""
        return True

    def exponent(self, value):
        """0: H is H₀."""
        return 0.0


log_hardening = formula(Hardness, Hardness.log_hardening)
softening_rate = formula(Hardness, Hardness.softening_rate)
root_is_unique = formula(Hardness, Hardness.root_is_unique)
