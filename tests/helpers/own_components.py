"""Small campaigns whose components are classes of modules beside them."""

import ast
import inspect

from campaign_runs import write_campaign

from agglom_mpi import components

STANDARD = """\
import math
from collections.abc import *
from functools import cached_property
from typing import *
import numpy as np
from numpy.typing import ArrayLike, NDArray
"""
"""Beginning of a module of copies."""

SPEED = '''\
"""A restitution by the approach speed."""

from typing import Annotated, ClassVar

from agglom_mpi.components import In, Restitution, RestitutionSolution


class SpeedRestitution(Restitution):
    """e = min(1, (w₁/w)^¼); slower grains than `sticking` bond."""

    speed: Annotated[float, In("m/s", above=0)] = 1.0
    sticking: Annotated[float, In("m/s", at_least=0, meaning="a speed like '1 cm/s'")]
    summary: ClassVar[str] = "falls with the fourth root of the approach speed"

    def solve_restitution(self, laws, pair):
        """Return e by the approach speed alone."""
        deficit = 1.0 - min(1.0, (self.speed / pair.approach_speed) ** 0.25)
        return RestitutionSolution(deficit, pair.approach_speed < self.sticking, 0.0, False)
'''
SCENE = """\
title: Own components
seed: 11
scene:
  particles: 40
  half_width: 1 cm
  velocities: {law: spread, mean: [0, 0, 0], transverse: 1}
  restitution: {law: "sticking.py:SpeedRestitution", speed: 3 m/s, sticking: 30 cm/s}
  heating: none
  end_time: 0.3 s
variables: {relative_speed: [0.5, 2], size_ratio: [0.3, 0.5], density: 2500}
objective: {law: growth_target, ratio: 1.5}
search: {method: random, population: 4}
ensemble: {rule: fixed, samples: 3}
stopping: {generations: 2}
final: {strings: 2, samples: 4}
"""
"""A campaign with that restitution."""
RESTITUTION_LINE = 1 + SCENE.splitlines().index(
    '  restitution: {law: "sticking.py:SpeedRestitution", speed: 3 m/s, sticking: 30 cm/s}'
)


def write_scene(folder, source=SPEED, *edits, name="own"):
    """Write `name`.yaml and the module of its restitution; texts of `edits` are replaced."""
    text = SCENE
    for old, new in edits:
        assert text.count(old) == 1, old
        text = text.replace(old, new)
    path = folder / f"{name}.yaml"
    path.write_text(text)
    if source is not None:
        (folder / "sticking.py").write_text(source)
    return path


def copies(*classes):
    """Return a module with copies of classes of the package, which imports the interface alone."""
    body = "\n\n".join(inspect.getsource(each) for each in classes)
    used = {node.id for node in ast.walk(ast.parse(body)) if isinstance(node, ast.Name)}
    names = sorted((used & set(components.__all__)) - {each.__name__ for each in classes})
    imported = f"from agglom_mpi.components import {', '.join(names)}\n" if names else ""
    return f"{STANDARD}{imported}\n\n{body}"


def write_copies(folder, name, module, classes, *edits, **numbers):
    """Write a campaign of the tests of runs with lines replaced, and a module of copies."""
    path = write_campaign(folder / f"{name}.yaml", **numbers)
    text = path.read_text()
    for old, new in edits:
        assert text.count(old) == 1, old
        text = text.replace(old, new)
    path.write_text(text)
    (folder / module).write_text(copies(*classes))
    return path
