"""The page on adding a submodel, followed word for word in a copy of the package."""

import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

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
IMPORT = r"(from agglom_mpi\.physics\.restitution import \(\n)"
USE = """
import sys
import agglom_mpi
from agglom_mpi.campaign import Campaign
from agglom_mpi.physics.encounter import Encounter
from agglom_mpi.physics.restitution import SpeedRestitution, solve_restitution

pair = Encounter(16.0, *[1.0] * 11)
print(agglom_mpi.__file__)
print(1.0 - solve_restitution(SpeedRestitution(1.0), None, pair).deficit)
print(1.0 - solve_restitution(SpeedRestitution(20.0), None, pair).deficit)
campaign = Campaign.from_text(sys.argv[1])
print("restitution: speed" in campaign.describe(), "fourth root" in campaign.describe())
outcome = campaign.simulate({}, sample=0)
print(outcome.collisions, outcome.merges, bool(outcome.record["momentum_error"] < 1e-12))
"""


def follow(package):
    """Make the edits of the page in a copy of the package."""
    text = (package / "physics" / "README.md").read_text()
    law, remembers, part, imported, made, meaning = re.findall(r"```python\n(.*?)```", text, re.S)
    edit(package / "physics" / "restitution.py", r"\Z", f"\n\n{law}")
    allocation = package / "simulation" / "allocation.py"
    edit(allocation, r"@new_impact_times\.answer\(Pressure[^\n]*\n", remembers)
    edit(allocation, IMPORT, r"\1    SpeedRestitution,\n")
    impact = package / "campaign" / "impact.py"
    edit(impact, r"AnyRestitution = Annotated\[\n.*?\n\]\n", "")
    edit(impact, r"\Z", f"\n\n{part}")
    edit(impact, r"from agglom_mpi\.campaign\.quantities import [^\n]*\n", imported)
    scene = package / "simulation" / "scene.py"
    edit(scene, r"(def _restitution\((?:.|\n)*?:\n)(?=    if)", rf"\g<1>{made}")
    edit(
        scene, r"(from agglom_mpi\.physics\.restitution import \(\n)", r"\1    SpeedRestitution,\n"
    )
    edit(package / "campaign" / "submodels.py", r"(MEANING: Final = \{\n)", rf"\g<1>{meaning}")


def edit(path, pattern, new):
    text, count = re.subn(pattern, new, path.read_text(), count=1, flags=re.S)
    assert count == 1, (path, pattern)
    path.write_text(text)


def test_the_page_on_adding_a_submodel_works_word_for_word(tmp_path):
    shutil.copytree(PACKAGE, tmp_path / "agglom_mpi", ignore=shutil.ignore_patterns("__pycache__"))
    follow(tmp_path / "agglom_mpi")
    done = subprocess.run(
        [sys.executable, "-c", USE, CAMPAIGN],
        env=os.environ | {"PYTHONPATH": str(tmp_path), "NUMBA_DISABLE_JIT": "1"},
        cwd=tmp_path,
        capture_output=True,
        text=True,
        timeout=120,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    where, sixteenth, slow, described, simulated = done.stdout.splitlines()
    assert Path(where).is_relative_to(tmp_path)
    assert float(sixteenth) == 0.5
    assert float(slow) == 1.0
    assert described == "True True"
    collisions, merges, keeps_momentum = simulated.split()
    assert int(collisions) > 3
    assert int(merges) == 0
    assert keeps_momentum == "True"
