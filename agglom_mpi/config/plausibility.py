"""Warnings about what is unlikely in a campaign, found before anything is computed.

All rules are functions of a scene and of the variables in SI units, so that they hold however the
values were given.
"""

import math
from collections.abc import Iterator, Mapping
from contextlib import suppress
from itertools import product
from typing import TYPE_CHECKING, Any, Final, NamedTuple

import numpy as np

from agglom_mpi.config.bounds import ABSENT
from agglom_mpi.config.given_strings import read_string
from agglom_mpi.config.size_warnings import Finding, unlikely_draws
from agglom_mpi.config.yaml_source import Problem, parse
from agglom_mpi.declaration.declared import FieldPath
from agglom_mpi.declaration.given_values import FRACTIONS
from agglom_mpi.declaration.units import quoted
from agglom_mpi.formatting import format_duration, in_unit, pluralise, value_with_prefix
from agglom_mpi.physics import scales
from agglom_mpi.physics.constants import LIGHT_SPEED
from agglom_mpi.variables import TEN, VariableTable

Value = dict[str, float]
"""The variables of a string in SI units, by name."""

if TYPE_CHECKING:
    from agglom_mpi.config.campaign import Campaign
    from agglom_mpi.config.scene import SceneSection


class Usual(NamedTuple):
    """Limits between which values of matter lie, SI units, and in words what is near them."""

    lower: float
    upper: float
    words: str


USUAL: Final = {
    "relative_speed": Usual(1e-6, 1e4, "from 1 µm/s to 10 km/s, where impacts begin to vaporise"),
    "density": Usual(20.0, 23_000.0, "from 20 kg/m^3, foams, to 22600, osmium"),
    "hardness": Usual(1e3, 2e11, "from 1 kPa, gels, to 150 GPa, diamond"),
    "heat_capacity": Usual(10.0, 15_000.0, "from 10 J/kg/K, solids at some K, to 14300, hydrogen"),
    "friction": Usual(0.0, 1.5, "from 0 to 1, seldom above"),
    "temperature": Usual(1.0, 4500.0, "from 1 K to 4200 K, where the last solids melt"),
    "activation_energy": Usual(0.0, 1e6, "from 0 to 1 MJ/mol, the strongest bonds"),
}
"""Ranges of existing materials and scenes, by the name of a variable."""

GRAINS: Final = Usual(1e-8, 0.1, "from 10 nm to 10 cm across")
"""Diameters of grains, m."""

NEWTONIAN: Final = 0.01
"""Fraction of the speed of light up to which energies by Newton's mechanics are right to 1e-4."""

SLOW: Final = 0.5
"""Fraction of the critical speed that no two grains reach at the start where nothing bonds: pairs
of unequal grains bond from 0.71 of it on, and collisions hardly raise the fastest speed."""

COLLISIONS_PER_SECOND: Final = 5e5
"""Collisions that one core handles per second with the event engine, at least."""
UNSTIRRED: Final = 1e4
"""Collisions per grain, were all elastic, after which grains that lose energy are at rest."""
LONG_SAMPLE: Final = 3600.0
"""Time of a sample in s above which it is warned of."""

DECISIVE: Final = (
    *("relative_speed", "size_ratio", "density", "hardness", "temperature", "activation_energy"),
)
"""Variables that the number of collisions until the end depends on."""


def implausible(
    campaign: "Campaign", given: Mapping[str, float | str] | None = None
) -> list[Problem]:
    """Return what is unlikely in a campaign, or in one string of it.

    Parameters
    ----------
    campaign
    given
        Values of a string as for `campaign.parameters`; None: the whole search box.
    """
    box = campaign.variables
    if given is None:
        lower, upper = box.lower, box.upper
        idle: Mapping[str, Any] = dict.fromkeys(box.ignored)
    else:
        lower = upper = read_string(campaign, given)
        used = {*box.used, *FRACTIONS}
        idle = {name: value for name, value in given.items() if name not in used}
    findings = [
        *_idle(idle),
        *_unusual(box, lower, upper),
        *_of_scenes(campaign, lower, upper),
        *(_of_data(campaign) if given is None else ()),
        *(_growth(campaign, lower, upper) if campaign.plan is not None else ()),
    ]
    source = parse(campaign.text, campaign.name)
    found = []
    for place, message in findings:
        name = ".".join(map(str, place[1:]))  # perhaps that of a number of the scene
        path = ("variables", name) if name in box.further_names else place
        own = given is not None and path[-1] in given
        field = str(path[-1]) if own else ".".join(map(str, path))
        found.append(Problem(campaign.name, None if own else source.line(path), field, message))
    return sorted(found, key=lambda problem: problem.line or 0)


def _idle(values: Mapping[str, Any]) -> Iterator[Finding]:
    """Yield values on which the scene does not depend; None where only the file has it."""
    for name, value in values.items():
        said = "is given" if value is None else f"is {quoted(value)}"
        message = f"{said}, but nothing depends on it: the scene has no {ABSENT[name]}"
        yield ("variables", name), message


def _scene_strings(campaign: "Campaign", lower: np.ndarray, upper: np.ndarray) -> list[np.ndarray]:
    """Return strings, (k,), whose scenes stand for those of all strings of a box.

    Where numbers of the scene are searched these are the middle and both ends.
    """
    one = not campaign.variables.of_scene or np.array_equal(lower, upper, equal_nan=True)
    return [lower] if one else [0.5 * (lower + upper), lower, upper]


def _of_scenes(campaign: "Campaign", lower: np.ndarray, upper: np.ndarray) -> Iterator[Finding]:
    strings = _scene_strings(campaign, lower, upper)
    first, *others = [list(_of_scene(campaign, string, lower, upper)) for string in strings]
    everywhere = [{path for path, _ in other} for other in others]
    for path, message in first:
        if all(path in paths for paths in everywhere):
            yield path, message


def _of_scene(
    campaign: "Campaign", string: np.ndarray, lower: np.ndarray, upper: np.ndarray
) -> Iterator[Finding]:
    """Yield what is unlikely in the scene of a string, with the other variables in their ranges."""
    scenes = campaign.scenes
    try:
        scene, values = scenes.at(string)
    except ValueError:  # reported where the box is checked
        return
    numbers = {name: values[name] for name in scenes.table.further_names}
    low, high = (
        scenes.of_values(TEN.values_by_name(end[: TEN.count]) | numbers).values
        for end in (lower, upper)
    )
    yield from _softening(scene, low, high)
    yield from _speeds(scene, high)
    yield from _bonding(scene, low, high)
    yield from _cautions(scene, low, high)
    yield from _sizes(scene, low, high)
    yield from unlikely_draws(scene, campaign.seed, high["size_ratio"])
    yield from _collisions(scene, low, high)


def _unusual(table: VariableTable, lower: np.ndarray, upper: np.ndarray) -> Iterator[Finding]:
    """Yield variables whose range has an end outside of `USUAL`."""
    for variable, low, high in zip(table.variables, lower.tolist(), upper.tolist(), strict=True):
        usual = USUAL.get(variable.name)
        if usual is None or np.isnan(low):
            continue
        too_small = low < usual.lower and not (variable.name == "relative_speed" and low == 0.0)
        if too_small or high > usual.upper:
            value = low if too_small else high
            text = in_unit(f"{value:g}", variable.unit)
            reaches = "is" if low == high else "reaches"
            yield ("variables", variable.name), f"{reaches} {text}; usual is {usual.words}"


def _of_data(campaign: "Campaign") -> Iterator[Finding]:
    """Yield measured diameters and radii that no grains have."""
    for i, entry in enumerate(campaign.data_entries):
        if entry.value is None or entry.kind.unit != "m":
            continue
        if not GRAINS.lower <= entry.value <= GRAINS.upper:
            size = value_with_prefix(entry.value, "m")
            message = f"is {size}; usual is {GRAINS.words}, and a number without a unit is in m"
            yield ("data", i, "value"), message


def _softening(scene: "SceneSection", soft: Value, hard: Value) -> Iterator[Finding]:
    """Yield the activation energy if it makes a usual hardness one that no matter has."""
    name = scene.hardness.softened_by
    if not scene.restitution.uses_contact_pressure or name is None:
        return
    usual = USUAL["hardness"]
    coldest = soft["temperature"]
    if coldest < USUAL["temperature"].lower:
        return
    exponent = scene.hardness.exponent(hard | {"temperature": coldest})
    power = math.log10(hard["hardness"]) + exponent / math.log(10.0)
    both_usual = all(hard[n] <= USUAL[n].upper for n in ("hardness", name))
    if both_usual and power > math.log10(usual.upper):
        fixed, unit = soft[name] == hard[name], TEN[name].unit
        message = (
            f"{'is' if fixed else 'reaches'} {hard[name]:g} {unit}, with which "
            f"grains at {coldest:g} K have a hardness of 10^{power:.3g} Pa; usual is "
            f"{usual.words}{scene.hardness.misprint}"
        )
        yield ("variables", name), message


def _speeds(scene: "SceneSection", fast: Value) -> Iterator[Finding]:
    """Yield a wide spread in y and z, and speeds at which mechanics is not Newton's."""
    speed, mean = fast["relative_speed"], scene.velocities.mean_flow
    across, usual = scene.velocities.transverse_speed(speed), USUAL["relative_speed"]
    if across > usual.upper >= speed:
        message = (
            f"is {across / speed:g}, which makes speeds up to {across:.3g} m/s in y and z; "
            f"usual is {usual.words}"
        )
        yield ("scene", "velocities", "transverse"), message
    share = (mean + speed) / LIGHT_SPEED
    if share > NEWTONIAN:
        flow: FieldPath = ("scene", "velocities", "mean")
        path: FieldPath = flow if mean > speed else ("variables", "relative_speed")
        message = (
            f"makes speeds up to {mean + speed:.3g} m/s, {share:.2g} of the speed of light; the "
            f"mechanics is Newtonian, valid up to {NEWTONIAN:g} of it"
        )
        yield path, message


def _bonding(scene: "SceneSection", low: Value, fast: Value) -> Iterator[Finding]:
    """Yield the length ratio if no grains of any string are fast enough to bond; see `SLOW`.

    Taken with the hardness of hot grains, as the heat of impacts softens them.
    """
    if not scene.restitution.uses_contact_pressure:
        return
    soft = fast | {"hardness": low["hardness"]}
    exponent = scene.hardness.least_exponent
    sticks_to, needed = scene.restitution.critical_speeds(scene, soft, exponent)
    if not math.isnan(sticks_to):
        return
    fastest = scales.fastest_approach(scene, fast)
    if 0.0 < fastest < SLOW * needed:
        field, value, usual = scene.duration.decisive_number
        message = (
            f"is {value}: two grains bond from {needed:.3g} m/s on, but approach each other at no "
            f"more than {fastest:.3g} m/s at the start, so that none bond{usual}"
        )
        yield ("scene", "duration", *field), message


def _cautions(scene: "SceneSection", low: Value, high: Value) -> Iterator[Finding]:
    """Yield what laws of the scene find doubtful at both ends of the ranges."""
    for key, law, is_used in scene.laws():
        if is_used:
            at_low = dict(law.cautions(scene, low))
            for path, message in law.cautions(scene, high):
                if path in at_low:
                    yield ("scene", *key.split("."), *path), message


def _sizes(scene: "SceneSection", low: Value, high: Value) -> Iterator[Finding]:
    """Yield the length of the box if it makes grains of a size that is not usual."""
    small, large = (2.0 * scales.grain_radius(scene, value) for value in (low, high))
    if small < GRAINS.lower or large > GRAINS.upper:
        size = small if small < GRAINS.lower else large
        message = (
            f"makes {scene.particles:,} grains of {value_with_prefix(size, 'm')}; usual are grains "
            f"{GRAINS.words}, and a number without a unit is in m"
        )
        yield ("scene", scene.size_key), message


def _collisions(scene: "SceneSection", low: Value, high: Value) -> Iterator[Finding]:
    """Yield the end time if it is too short for collisions, or too long to be simulated."""
    if scene.escape.is_sheared():  # the flow brings grains together
        return
    counts = _expected(scene, low, high)
    if not counts:
        return
    most, typical = max(counts), counts[-1]
    if most < 1.0:
        speed = "where nothing moves" if most == 0.0 else "by kinetic theory"
        message = (
            f"ends before grains meet: {most:.2g} collisions per grain are expected at most, "
            f"{speed}; usual are 1 and more"
        )
        yield ("scene", "end_time"), message
    seconds = 0.5 * typical * scene.particles / COLLISIONS_PER_SECOND
    if not scene.engine.has_time_steps and seconds > LONG_SAMPLE:
        message = (
            f"makes a sample take {format_duration(seconds)} unless grains bond or come to rest: "
            f"{typical:.2g} collisions per grain are expected; usual are seconds, below 1e6"
        )
        yield ("scene", "end_time"), message
    elif typical > UNSTIRRED and scene.restitution.never_bonds is None:
        message = (
            f"lasts for {typical:.2g} collisions per grain, if all were elastic; nothing stirs the "
            "grains, which slow down and merge in the first part of it: seconds in a mixer must be "
            f"a short effective time; usual are up to {UNSTIRRED:g}"
        )
        yield ("scene", "end_time"), message


def _expected(scene: "SceneSection", low: Value, high: Value) -> list[float]:
    """Return the collisions per grain that are expected in the box's corners, and in its centre."""
    searched = [name for name in DECISIVE if low[name] < high[name]]
    counts = []
    for shares in [*product((0.0, 1.0), repeat=len(searched)), (0.5,) * len(searched)]:
        value = dict(low)
        for name, share in zip(searched, shares, strict=True):
            value[name] = (1.0 - share) * low[name] + share * high[name]
        try:
            counts.append(scales.expected_collisions(scene, value))
        except (ValueError, ArithmeticError):  # such scales are refused where they are used
            return []
    return counts


def _growth(campaign: "Campaign", lower: np.ndarray, upper: np.ndarray) -> Iterator[Finding]:
    """Yield the objective if it wants growth of a scene in which nothing can bond."""
    growth = campaign.objective.wanted_growth
    strings = _scene_strings(campaign, lower, upper)
    reasons = set()
    for string in strings:
        with suppress(ValueError):  # reported where the box is checked
            reasons.add(campaign.at(string).section.restitution.never_bonds)
    if growth is None or None in reasons or not reasons:
        return
    alike = f"a {campaign.scene.restitution.name} restitution"
    reason = reasons.pop() if len(reasons) == 1 else alike
    field, wanted = growth
    if wanted > 1.0:
        grains = pluralise(campaign.scene.particles, "grain")
        message = (
            f"wants a mean b/b0 of {wanted:.4g}, but with {reason} no "
            f"grains bond, and b/b0 stays 1; within reach with bonding are 1 to N^(1/3) of {grains}"
        )
        yield ("objective", *field), message
