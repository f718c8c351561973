"""The page on adding a law, followed in a copy of the package; beside a campaign: test_own_laws."""

import os
import re
import shutil
import sys
from pathlib import Path

from processes import output_of, program

import agglom_mpi

PACKAGE = Path(agglom_mpi.__file__).parent
CAMPAIGN = """
seed: 1
scene:
  particles: 20
  half_width: 1 cm
  velocities: {law: spread, mean: [0, 0, 0], transverse: 1}
  restitution: {law: speed, speed: 10 cm/s}
  heating: none
  end_time: 20 ms
variables: {relative_speed: 5, size_ratio: 0.5, density: 2500}
"""
USE = """
import sys
import agglom_mpi
from agglom_mpi.config.campaign import Campaign
from agglom_mpi.verbs.simulate import simulate
from agglom_mpi.physics.pair import ContactPair
from agglom_mpi.physics.restitution import SpeedRestitution, solve_restitution

pair = ContactPair(16.0, *[1.0] * 13)
print(agglom_mpi.__file__)
print(1.0 - solve_restitution(SpeedRestitution.Numbers(1.0), None, pair).deficit)
print(1.0 - solve_restitution(SpeedRestitution.Numbers(20.0), None, pair).deficit)
campaign = Campaign.from_text(sys.argv[1])
print("restitution: speed" in campaign.describe(), "fourth root" in campaign.describe())
outcome = simulate(campaign, {}, sample=0)
print(outcome.collisions, outcome.merges, bool(outcome.record["momentum_error"] < 1e-12))
"""


def follow(package):
    """Add the law of the page, with a field for its name, to a copy of the package."""
    text = (package / "physics" / "README.md").read_text()
    (law,) = re.findall(r"```python\n.*?(class .*?)```", text, re.S)
    [field] = re.findall(r"`(law: Literal.*?)`", text)
    law, count = re.subn(r"\n    speed: ", f"\n    {field}\n    speed: ", law)
    assert count == 1
    path = package / "physics" / "restitution.py"
    path.write_text(f"{path.read_text()}\n\n{law}")


def test_the_page_on_adding_a_law_to_the_package_works(tmp_path):
    shutil.copytree(PACKAGE, tmp_path / "agglom_mpi", ignore=shutil.ignore_patterns("__pycache__"))
    follow(tmp_path / "agglom_mpi")
    variables = os.environ | {"PYTHONPATH": str(tmp_path), "NUMBA_DISABLE_JIT": "1"}
    with program([sys.executable, "-c", USE, CAMPAIGN], cwd=tmp_path, env=variables) as process:
        said, complaint = output_of(process)
    assert process.returncode == 0, complaint
    where, sixteenth, slow, described, simulated = said.splitlines()
    assert Path(where).is_relative_to(tmp_path)
    assert float(sixteenth) == 0.5
    assert float(slow) == 1.0
    assert described == "True True"
    collisions, merges, keeps_momentum = simulated.split()
    assert int(collisions) > 3
    assert int(merges) == 0
    assert keeps_momentum == "True"
