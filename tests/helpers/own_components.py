"""Small campaigns whose components are classes of modules beside them."""

import ast
import inspect
import re
from inspect import getmodule

from campaign_runs import write_campaign

from agglom_mpi import components
from agglom_mpi.physics.contact import LengthDuration, MeanSpeedDuration
from agglom_mpi.physics.friction import RestitutionScaledFriction
from agglom_mpi.physics.hardness import ArrheniusHardness
from agglom_mpi.physics.heating import PairSplit
from agglom_mpi.physics.reaction import ContactAreaReaction
from agglom_mpi.physics.restitution import PressureRestitution
from agglom_mpi.physics.velocities import UniformX
from agglom_mpi.search.methods.genetic import Genetic, GeneticSearch, Rescale
from agglom_mpi.search.objectives.growth import GrowthTarget
from agglom_mpi.search.stopping import StandardError, _t_95_of

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
    values = {key: value for each in classes for key, value in vars(getmodule(each)).items()}
    numbers = sorted(
        name for name in used - set(names) if isinstance(values.get(name), int | float | dict)
    )
    constants = "".join(f"{name} = {values[name]!r}\n" for name in numbers)
    return f"{STANDARD}{imported}{constants}\n\n{body}"


ALL = {
    "velocities": UniformX,
    "duration": MeanSpeedDuration,
    "hardness": ArrheniusHardness,
    "friction": RestitutionScaledFriction,
    "heating": PairSplit,
    "reaction": ContactAreaReaction,
    "restitution": PressureRestitution,
    "objective": GrowthTarget,
    "search": Genetic,
    "ensemble": StandardError,
}
"""Classes that a campaign has copies of, by key."""
DECIDING = ("objective", "search", "ensemble")
"""Those that no kernel is compiled for."""
NAMES_OF_ALL = tuple(f"mine.py:{each.__name__}" for each in ALL.values())
GIVEN = (
    ("velocities: uniform_x", "velocities: {law: uniform_x}"),
    ("  hardness: arrhenius", "  hardness: {law: arrhenius}"),
    ("  friction: restitution_scaled", "  friction: {law: restitution_scaled}"),
    (
        "  reaction: contact_area",
        "  reaction: {law: contact_area}\n  heating: {law: pair_split}\n"
        "  restitution: {law: pressure}",
    ),
    ("search: {population", "search: {method: genetic, population"),
)
"""Short forms of a campaign, and long ones."""


NUMBERS_OF_COPIES = {
    **{"generations": 2, "max_samples": 8, "population": 4, "parents": 2},
    "final": "{strings: 2, samples: 4}",
}
"""Numbers of a campaign that takes a second."""


def write_copies(folder, name, copied=tuple(ALL), **numbers):
    """Write the campaign of the tests of runs, with some of `ALL` copied to `mine.py`."""
    path = write_campaign(folder / f"{name}.yaml", **numbers)
    text = path.read_text()
    for short, long in GIVEN:
        assert text.count(short) == 1, short
        text = text.replace(short, long)
    for each in map(ALL.get, copied):
        old = f"{each.named_by}: {each.names()[0]}"
        assert len(re.findall(rf"{old}\b", text)) == 1, old
        text = re.sub(rf"{old}\b", f'{each.named_by}: "mine.py:{each.__name__}"', text)
    path.write_text(text)
    text = copies(LengthDuration, Rescale, *ALL.values(), GeneticSearch, _t_95_of)
    (folder / "mine.py").write_text(text)
    return path


SIZES = '''\
"""A law of sizes."""

from typing import Annotated, ClassVar

from agglom_mpi.components import In, Sizes, UniformDistribution


class Flat(Sizes):
    """Uniform, the largest `ratio` times the smallest."""

    ratio: Annotated[float, In("1", above=1, at_most=10)]
    summary: ClassVar[str] = "flat"

    @property
    def mean_diameter(self):
        """None: relative to the mean."""
        return None

    def build(self):
        """Return the distribution."""
        mean = 0.5 * (1.0 + self.ratio)
        return UniformDistribution(1.0 / mean, self.ratio / mean)
'''
SEARCHED_SIZES = """\
seed: 11
scene:
  particles: 20
  grain_diameter: 1 mm
  sizes: {law: "flat.py:Flat"}
  velocities: {law: spread, mean: [0, 0, 0], transverse: 1}
  restitution: {law: constant, value: 0.8}
  heating: none
  end_time: 1 ms
variables: {sizes.ratio: [1.5, 3], relative_speed: [0.5, 2], volume_fraction: 0.05, density: 2500}
derived: {largest: sizes.ratio * grain_diameter}
constraints: [largest < 2.9 mm]
objective: {law: growth_target, ratio: 1.5}
search: {method: random, population: 4}
ensemble: {rule: fixed, samples: 2}
stopping: {generations: 2}
final: {strings: 2, samples: 2}
"""
"""A campaign that searches a number of that law."""
