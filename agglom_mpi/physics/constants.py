"""Universal constants (CODATA 2018, SI)."""

from typing import Final

GAS_CONSTANT: Final = 8.314462618
"""R, J/(mol K)."""

LIGHT_SPEED: Final = 299_792_458.0
"""c, m/s."""

STEFAN_BOLTZMANN: Final = 5.670374419e-8
"""B, W/(m² K⁴)."""
