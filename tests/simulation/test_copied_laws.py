"""Laws of one's own compile into the kernels: copies of the package's give the same bits."""

from pathlib import Path

import numpy as np
import pytest
from own_components import copies
from plain_python import PLAIN, PLAIN_ALONE

from agglom_mpi import load_campaign
from agglom_mpi.physics.contact import CompressionRecoveryDuration, LengthDuration
from agglom_mpi.physics.cooling import QuarticCooling, RadiativeCooling
from agglom_mpi.physics.fragmentation import PairEnergyFragmentation
from agglom_mpi.physics.friction import ConstantFriction
from agglom_mpi.physics.heating import OwnEnergy
from agglom_mpi.physics.restitution import ConstantRestitution, LastingContact
from agglom_mpi.physics.sizes import LognormalSizes, UniformSizes
from agglom_mpi.physics.velocities import SpreadVelocities
from agglom_mpi.verbs.simulate import simulate

JOBS = Path(__file__).parents[2] / "jobs"
SCENE = """\
title: Two grains
seed: 3
scene:
  particles: 60
  {size}
  velocities: {velocities}
  restitution: {restitution}
  duration: {duration}
  hardness: arrhenius
  friction: {friction}
  heating: {heating}
  reaction: contact_area
  fragmentation: {fragmentation}
  cooling: {cooling}
  end_time: 2 ms
variables:
  relative_speed: 20
  size_ratio: 0.5
  density: 6000
  hardness: 5e7
  heat_capacity: 1000
  friction: 0.3
  temperature: 300
  activation_energy: 500
  reaction_heat: 1e6
  surface_energy: 10
"""
FIRST = {
    "size": ("half_width: 1 cm\n  sizes: {law: NAME, spread: 1.3}", "lognormal", LognormalSizes),
    "velocities": ("{law: NAME, mean: [0, 0, 1]}", "spread", SpreadVelocities),
    "restitution": ("pressure", "", None),
    "duration": ("{law: NAME}", "compression_recovery", CompressionRecoveryDuration),
    "friction": ("{law: NAME}", "constant", ConstantFriction),
    "heating": ("pair_split", "", None),
    "fragmentation": ("{law: NAME}", "pair_energy", PairEnergyFragmentation),
    "cooling": (
        "{law: NAME, emissivity: 0.9, surroundings: 4 K, convection: 2, ambient: 250 K}",
        "radiation",
        RadiativeCooling,
    ),
}
SECOND = FIRST | {
    "size": (
        "sizes: {law: NAME, smallest: 1 mm, largest: 2 mm, basis: volume}",
        "uniform",
        UniformSizes,
    ),
    "restitution": (
        "{law: NAME, value: 0.8, contact_time: 1 us}\n  solver: bracketed_root",
        "constant",
        ConstantRestitution,
    ),
    "duration": ("{law: mean_speed}", "", None),
    "heating": ("{law: NAME}", "own_energy", OwnEnergy),
    "fragmentation": ("none", "", None),
    "cooling": ("{law: NAME}", "quartic", QuarticCooling),
}


def scene_text(laws, own):
    """Return a scene with the package's laws, or with copies of them in `mine.py`."""
    entries = {}
    for key, (entry, name, kind) in laws.items():
        named = f'"mine.py:{kind.__name__}"' if own and kind is not None else name
        entries[key] = entry.replace("NAME", named)
    text = SCENE.format(**entries)
    if entries["restitution"].startswith("{law"):
        text = text.replace("  hardness: arrhenius\n", "").replace("  solver: bracketed_root\n", "")
    return text


@pytest.mark.parametrize(
    "laws",
    [
        pytest.param(FIRST, id="first", marks=PLAIN_ALONE),
        pytest.param(SECOND, id="second", marks=PLAIN),
    ],
)
def test_copies_of_laws_give_the_same_bits(tmp_path, laws):
    kinds = [kind for _, _, kind in laws.values() if kind is not None]
    extra = [LengthDuration] if CompressionRecoveryDuration in kinds else []
    extra_after = [LastingContact] if ConstantRestitution in kinds else []
    (tmp_path / "mine.py").write_text(copies(*extra, *kinds, *extra_after))
    outcomes = []
    for own in (False, True):
        path = tmp_path / f"{own}.yaml"
        path.write_text(scene_text(laws, own))
        campaign = load_campaign(path, allow_code=own)
        outcomes.append([simulate(campaign, campaign.parameters(), k) for k in range(1)])
        assert len(campaign.scene.sizes.entries()) > 1
    for builtin, copied in zip(*outcomes, strict=True):
        assert builtin.collisions > 60
        for name in builtin.record.dtype.names:
            if "seconds" not in name:
                assert builtin.record[name].tobytes() == copied.record[name].tobytes(), name
        assert np.array_equal(builtin.radii, copied.radii)
        assert np.array_equal(builtin.temperatures, copied.temperatures, equal_nan=True)
