"""Laws of the package as they are tested: each in a scene of simple laws."""

from agglom_mpi.contracts.subject import Subject
from agglom_mpi.physics.contact import CompressionRecoveryDuration, ContactArea, Duration
from agglom_mpi.physics.cooling import Cooling
from agglom_mpi.physics.fragmentation import Fragmentation, PairEnergyFragmentation
from agglom_mpi.physics.friction import ConstantFriction, Friction
from agglom_mpi.physics.hardness import ArrheniusHardness, Hardness
from agglom_mpi.physics.heating import Heating, PairSplit
from agglom_mpi.physics.impact_solvers import BracketedRoot
from agglom_mpi.physics.reaction import ContactAreaReaction, Reaction
from agglom_mpi.physics.restitution import (
    ConstantRestitution,
    PressureRestitution,
    Restitution,
    Solver,
)
from agglom_mpi.physics.velocities import Velocities

KEYS = {
    "restitution": Restitution,
    "duration": Duration,
    "hardness": Hardness,
    "friction": Friction,
    "heating": Heating,
    "reaction": Reaction,
    "fragmentation": Fragmentation,
    "solver": Solver,
    "cooling": Cooling,
    "velocities": Velocities,
}
"""Kinds of laws by their keys in a scene."""

SCENE = {
    "restitution": PressureRestitution(),
    "duration": CompressionRecoveryDuration(),
    "contact_area": ContactArea(),
    "hardness": ArrheniusHardness(),
    "friction": ConstantFriction(),
    "heating": PairSplit(),
    "reaction": ContactAreaReaction(),
    "fragmentation": PairEnergyFragmentation(),
    "solver": BracketedRoot(),
}
"""Laws of an impact."""

GIVEN = {
    "value": 0.5,
    "emissivity": 0.8,
    "surroundings": 300.0,
    "dry": ConstantRestitution(value=0.9),
    "youngs_modulus": 1e9,
    "dissipative_constant": 1e-6,
    "restitution": 0.8,
    "speed": 1.0,
    "radius": 1e-3,
    "viscosity": 1e-3,
    "film_thickness": 1e-6,
    "roughness": 1e-7,
    "coefficient": 0.3,
    "tangential": 0.44,
}
"""Numbers and laws that laws need."""

ALTERNATIVES = {"yield_pressure": 1e8}
"""Numbers that laws need unless another one is given."""


def instance(kind):
    """Return a law with the numbers that it needs."""
    needed = [name for name, field in kind.model_fields.items() if field.is_required()]
    chosen = {name: value for name, value in ALTERNATIVES.items() if name in kind.model_fields}
    return kind._made({name: GIVEN[name] for name in needed} | chosen)


def subject_of(kind, **scene):
    """Return a law of the class as it is tested, in a scene with other laws replaced."""
    law = instance(kind)
    key = next(key for key, base in KEYS.items() if issubclass(kind, base))
    return Subject(law, {**SCENE, **scene, **({key: law} if key in SCENE else {})})
