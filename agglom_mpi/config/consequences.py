"""Consequences of a campaign's scene and variables, as `agglom check` prints them."""

import math
from collections.abc import Callable, Iterator
from itertools import product
from typing import TYPE_CHECKING, Any, Final

import numpy as np
from numpy.typing import NDArray

from agglom_mpi.config.quantities import BY_NAME, Quantity, Value, one_by_one
from agglom_mpi.declaration.laws import Reported
from agglom_mpi.formatting import in_unit, value_with_prefix
from agglom_mpi.physics import scales
from agglom_mpi.random_streams import CONSEQUENCES, search_stream
from agglom_mpi.search.space import SearchSpace

if TYPE_CHECKING:
    from agglom_mpi.config.campaign import Campaign
    from agglom_mpi.config.scene import SceneSection

Floats = NDArray[np.float64]

STRINGS: Final = 512
"""Number of random strings, beside all corners of the box, that ranges are estimated from."""
PREFIXED: Final = frozenset({"m", "s", "Pa", "W/m^3", "J", "J/m^2", "W", "N", "1/s"})
"""Units that take a decimal prefix."""


def _impact_pressure(scene: "SceneSection", value: Value) -> float:
    """Return the mean pressure of an impact of equal grains at v⁰ over twice the hardness."""
    pressure = scene.duration.pressure(value["density"], value["relative_speed"])
    return pressure / (2.0 * value["hardness"]) * math.exp(-scene.hardness.exponent(value))


def _surface_energy(scene: "SceneSection", value: Value) -> float:
    """Return 4πb²γ/(m v⁰²/4), a grain's surface energy over the energy of an impact of two."""
    surface = 4.0 * math.pi * scales.grain_radius(scene, value) ** 2 * value["surface_energy"]
    energy = 0.25 * scales.grain_mass(scene, value) * value["relative_speed"] ** 2
    return surface / energy


def _speed(label: str, note: str, name: str) -> Quantity:
    return Quantity(
        *(label, "m/s", note),
        lambda scene, v: getattr(scene.restitution.critical_speeds(scene, v), name),
    )


def _reported(key: str, number: Reported) -> Callable[["SceneSection", Any], float]:
    """Return the function of a number that the law at a path of the scene reports."""

    def compute(scene: "SceneSection", value: Value) -> float:
        laws = {each.key: each.law for each in scene.laws()}
        return number.evaluate(laws[key], scene, value)

    return compute


def _quantities(scene: "SceneSection") -> Iterator[Quantity]:
    mixed = scene.sizes is not None
    theory = "Enskog's theory of mixtures" if mixed else "Enskog's theory"
    yield Quantity("grain diameter", "m", "mean" * mixed, BY_NAME["grain_diameter"].compute)
    yield Quantity("edge of the box", "m", "", lambda scene, v: 2.0 * scales.half_width(scene, v))
    yield Quantity("volume fraction", "1", "", BY_NAME["volume_fraction"].compute)
    yield Quantity("mean free path", "m", "mean over all sizes" * mixed, scales.free_path)
    yield Quantity("end time", "s", "", scales.end_time)
    collisions = f"{theory}, elastic impacts"
    yield Quantity("collisions per grain", "1", collisions, scales.expected_collisions)
    yield Quantity("grain mass", "kg", "at the mean radius" * mixed, scales.grain_mass)
    if scene.velocities.mean_flow > 0.0:
        note = "common velocity of all grains, velocities.mean; causes no impacts"
        yield Quantity("mean flow", "m/s", note, lambda scene, value: scene.velocities.mean_flow)
    if scene.restitution.uses_contact_pressure:
        head_on = "two grains at the start, head-on"
        yield Quantity("fastest approach", "m/s", head_on, scales.fastest_approach)
        note = "two grains, head-on, at the starting temperature"
        yield _speed("grains bond from", note, "bonds_from")
        note = f"impact at relative_speed; grains bond from {scene.contact_area.final:g}"
        yield Quantity("impact pressure/hardness", "1", note, _impact_pressure)
    if scene.restitution.has_critical_speed and not scene.restitution.needs_contact_pressure:
        note = "colliding grains, if all impacts were elastic"
        yield Quantity(MEAN_APPROACH, "m/s", note, scales.mean_approach)
        yield _speed(STICKS_TO, "two mean grains, head-on", "sticks_to")
    for key, law, is_used in scene.laws():
        for each in law.reported() if is_used else ():
            yield Quantity(each.label, each.unit, each.note, _reported(key, each))
    if not scene.fragmentation.is_absent:
        note = "surface energy of a grain over kinetic energy of an impact"
        yield Quantity("surface/impact energy", "1", note, _surface_energy)


MEAN_APPROACH: Final = "mean approach speed"
STICKS_TO: Final = "grains stick up to"
"""Labels of the speeds that decide the fate of a mean pair."""


def consequences(campaign: "Campaign") -> list[str]:
    """Return lines on what follows, a range over the box where it depends on what is searched.

    Only strings that satisfy the constraints count. A value that is no number in float64 is left
    out, as for a scene that is refused.
    """
    strings = _strings(campaign)
    rows = campaign.scenes.rows(campaign.variables.columns_by_name(strings))
    derived, values, lines = campaign.derived_values(strings), dict[str, Floats](), []
    for each in _quantities(campaign.scene):
        values[each.name] = one_by_one(rows, each)
        lines.append(_line(each.name, each.unit, values[each.name], each.meaning))
        if each.name == STICKS_TO:
            lines.append(_fate(values[MEAN_APPROACH], values[STICKS_TO]))
    for own in campaign.relations.derived:
        lines.append(_line(own.name, own.unit, derived[own.name], f"= {own.text}"))
    return [line for line in lines if line]


def _strings(campaign: "Campaign") -> Floats:
    """Return allowed strings, (n, k), of the corners of the box and within it."""
    bounds, space = campaign.variables, SearchSpace.of(campaign.variables)
    if not space.dimensions:
        return campaign.variables.at(0.5)[None]
    corners = np.tile(bounds.lower, (2**space.dimensions, 1))
    corners[:, space.searched] = list(
        product(*zip(bounds.lower[space.searched], bounds.upper[space.searched], strict=True))
    )
    random = search_stream(campaign.seed, CONSEQUENCES)
    strings = np.vstack((corners, space.from_unit(random.random((STRINGS, space.dimensions)))))
    return strings[campaign.allowed_strings(strings)].reshape(-1, bounds.count)


def _line(label: str, unit: str, values: Any, note: str) -> str:
    """Return a line on values, empty if none of them is a number."""
    finite = np.asarray(values)[np.isfinite(values)]
    if not len(finite):
        return ""
    low, high = (_text(float(value), unit) for value in (finite.min(), finite.max()))
    text = low if low == high else f"{low} .. {high}"
    return f"{label:<25} {text:<25} {note}".rstrip()


def _fate(approach: Any, sticking: Any) -> str:
    """Return a line on the fate of the mean pair, by its approach over the sticking speed."""
    with np.errstate(divide="ignore", invalid="ignore"):
        ratio = np.asarray(approach) / np.asarray(sticking)
    finite = ratio[np.isfinite(ratio)]
    if not len(finite):
        return ""
    low, high = float(finite.min()), float(finite.max())
    fate = "sticks" if high <= 1.0 else "bounces" if low > 1.0 else "sticks or bounces"
    share = f"{low:.2g}" if low == high else f"{low:.2g} .. {high:.2g}"
    return f"{'mean pair':<25} {fate}: {share} of the sticking speed"


def _text(value: float, unit: str) -> str:
    if unit in PREFIXED:
        return value_with_prefix(value, unit)
    return in_unit(f"{value:.3g}", unit)
