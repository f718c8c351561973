"""The page on adding a component, followed word for word in a copy of the package."""

import os
import re
import shutil
import sys
from pathlib import Path

from processes import output_of, program

import agglom_mpi

PACKAGE = Path(agglom_mpi.__file__).parent
USE = """
import sys
from types import SimpleNamespace
import agglom_mpi
from agglom_mpi.config.campaign import Campaign
from agglom_mpi.config.yaml_source import CampaignError
from agglom_mpi.search.proposals import Ranked

campaign = Campaign.from_text(sys.argv[1])
print(agglom_mpi.__file__)
print("objective of the best string at most 0.25" in campaign.describe())
print(campaign.identity()["stopping.best"])
search = SimpleNamespace(best=lambda k: [Ranked(7, 0.25)])
print(campaign.stopping.ending.met(1, search).reached)
try:
    Campaign.from_text(sys.argv[1].replace("best: 0.25", "best: 0"))
except CampaignError as error:
    print(error.problems[0].line, error.problems[0].field)
"""
CAMPAIGN = """
seed: 1
scene: {particles: 20, half_width: 1 cm, restitution: {law: constant, value: 0}, heating: none,
        velocities: uniform_x, end_time: 20 ms}
variables: {relative_speed: [1, 5], size_ratio: 0.5, density: 2500}
objective: maximum_growth
ensemble: {rule: fixed, samples: 2}
stopping: {generations: 25, best: 0.25}
"""


def test_the_page_on_adding_a_component_works_word_for_word(tmp_path):
    shutil.copytree(PACKAGE, tmp_path / "agglom_mpi", ignore=shutil.ignore_patterns("__pycache__"))
    folder = tmp_path / "agglom_mpi" / "search"
    (code,) = re.findall(r"```python\n(.*?)```", (folder / "README.md").read_text(), re.S)
    (folder / "best_objective.py").write_text(code)
    # Another package than the one whose kernels are in the cache.
    variables = os.environ | {"PYTHONPATH": str(tmp_path), "NUMBA_DISABLE_JIT": "1"}
    with program([sys.executable, "-c", USE, CAMPAIGN], cwd=tmp_path, env=variables) as process:
        said, complaint = output_of(process)
    assert process.returncode == 0, complaint
    where, described, recorded, reached, place = said.splitlines()
    assert Path(where).is_relative_to(tmp_path)
    assert described == "True"
    assert recorded == "0.25"
    assert "0.25" in reached
    assert place == "8 stopping.best"
