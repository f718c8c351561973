"""Scenes drawn log-uniformly over everything at once, as campaign files say them."""

import json
import math
from typing import Any, NamedTuple

from hypothesis import strategies as st

from agglom_mpi.config.campaign import Campaign
from agglom_mpi.declaration.given_values import MAX_SIZE_RATIO

R = 8.314462618
LARGEST_FRACTION = math.pi / 6.0 * MAX_SIZE_RATIO**3
"""Volume fraction beyond which a campaign is refused: random placement jams."""


def decades(low, high):
    """Powers of ten from 10^low to 10^high, sixteen to a decade, each as likely as any other."""
    return st.integers(16 * low, 16 * high).map(lambda k: 10.0 ** (k / 16.0))


def zero_or(values, chance=4):
    """Zero once in `chance`; Hypothesis shrinks towards it."""
    return st.integers(1, chance).flatmap(lambda k: st.just(0.0) if k == 1 else values)


NUMBERS = st.one_of(
    st.integers(2, 5), st.integers(2, 40), st.integers(10, 50), st.integers(33, 100)
)
FRACTIONS = st.one_of(
    decades(-9, -1),
    decades(-3, -1),
    st.integers(5, 37).map(lambda k: k / 100.0),
    st.integers(5, 38).map(lambda k: min(k / 100.0, LARGEST_FRACTION)),
)
LASTING = st.one_of(decades(-3, 1), decades(0, 1), decades(0, 1), decades(1, 2))
"""End times over the time of a free flight."""

MARGINAL = st.tuples(st.integers(0, 16), st.sampled_from([-1.0, 1.0])).map(
    lambda drawn: 1.0 + drawn[1] * 10.0 ** -drawn[0] / 2.0
)
"""Numbers beside 1."""

POSITIONS_OF_UNITS = {
    "relative_speed": (1, 0, -1),
    "density": (-3, 1, 0),
    "hardness": (-1, 1, -2),
    "heat_capacity": (2, 0, -2),
    "reaction_heat": (0, 1, -2),
    "surface_energy": (0, 1, -2),
}
"""Powers of length, mass and time in the variables that have any; kelvin and mole stay."""


class Drawn(NamedTuple):
    """A scene section, the values of its variables in SI units, and a sample's number."""

    scene: dict[str, Any]
    values: dict[str, float]
    sample: int

    def campaign(self):
        """Read the campaign file that says this."""
        return Campaign.from_text(
            json.dumps(
                {
                    "scene": self.scene,
                    "variables": self.values,
                    "objective": "maximum_growth",
                    "ensemble": {"rule": "standard_error", "tolerance": 1.0, "max_samples": 9},
                    "stopping": {"generations": 1},
                }
            )
        )

    def in_units(self, length, mass, time):
        """Return the same in units that are smaller by these factors; 'smaller' numbers grow."""

        def factor(powers):
            return length ** powers[0] * mass ** powers[1] * time ** powers[2]

        scene = json.loads(json.dumps(self.scene))
        scene["half_width"] *= length
        scene["end_time"] *= time
        scene["velocities"]["mean"] = [v * length / time for v in scene["velocities"]["mean"]]
        if "contact_time" in scene["restitution"]:
            scene["restitution"]["contact_time"] *= time
        if scene["cooling"] != "none":
            scene["cooling"]["emissivity"] *= factor((0, 1, -3))
            scene["cooling"]["convection"] *= factor((0, 1, -3))
        for limit in ("floor", "ceiling"):
            if limit in scene["engine"]:
                scene["engine"][limit] *= time
        values = {
            name: value * factor(POSITIONS_OF_UNITS.get(name, (0, 0, 0)))
            for name, value in self.values.items()
        }
        return Drawn(scene, values, self.sample)


def volume(radius):
    return 4.0 / 3.0 * math.pi * radius**3


@st.composite
def grains(draw, most_drift):
    """Draw a box of grains, how fast they are, and how long to look."""
    number, radius, fraction = draw(NUMBERS), draw(decades(-9, 3)), draw(FRACTIONS)
    size_ratio = min((6.0 * fraction / math.pi) ** (1.0 / 3.0), MAX_SIZE_RATIO)
    half_width = radius * number ** (1.0 / 3.0) / size_ratio
    density = draw(decades(-3, 9))
    speed = draw(zero_or(decades(-12, 8), 16))
    drift = draw(st.sampled_from([0.0, *(d for d in (1.0, 10.0, 1e3, 1e6) if d <= most_drift)]))
    # As long as a grain takes for a few collisions, or for a few boxes if it has none.
    crowding = number / (2.0 * half_width) ** 3
    flight = min(4.0 * half_width, 1.0 / (crowding * 4.0 * math.pi * radius**2))
    if most_drift <= 10.0:
        flight /= 1.0 + drift
    end_time = draw(LASTING) * flight / speed if speed > 0.0 else draw(decades(-12, 12))
    mean = drift * (speed if speed > 0.0 else flight / end_time)
    return (
        {
            "particles": number,
            "half_width": half_width,
            "velocities": {
                "law": "spread",
                "mean": [mean, -0.3 * mean, 0.01 * mean],
                "transverse": draw(st.sampled_from([1.0, 1.0, 0.1, 0.0])),
            },
            "end_time": end_time,
        },
        {
            "relative_speed": speed,
            "size_ratio": size_ratio,
            "density": density,
        },
        radius,
    )


@st.composite
def thermal(draw, box, values, radius):
    """Draw temperature, heat capacity and all that heats, cools and breaks."""
    speed, mass = values["relative_speed"], values["density"] * volume(radius)
    theta = draw(decades(-3, 6))
    capacity = draw(decades(-3, 6))
    if speed > 0.0 and draw(st.booleans()):
        capacity = speed**2 / theta * draw(decades(-6, 6))
    area = math.pi * radius**2
    rise = draw(zero_or(decades(-6, 6)))
    tough = mass * speed**2 / area if speed > 0.0 else 1.0
    lasting = box["end_time"] * draw(decades(-12, 12))
    return {
        "reaction": "contact_area",
        "cooling": {
            "law": "radiation",
            "emissivity": draw(zero_or(decades(-6, 0))),
            "surroundings": draw(zero_or(decades(-3, 6))),
            "convection": draw(zero_or(st.just(values["density"] * radius * capacity / lasting))),
            "ambient": draw(zero_or(decades(-3, 6))),
        },
    }, {
        "temperature": theta,
        "heat_capacity": capacity,
        "reaction_heat": rise * mass * capacity / area,
        "surface_energy": tough * draw(st.one_of(decades(-12, 0), decades(-12, 12))),
        "friction": draw(zero_or(decades(-6, 3))),
    }


@st.composite
def pressure_laws(draw, values, thermal_values, radius, duration):
    """Draw hardness, softening and contact area; X of a typical impact often near 1."""
    ratio = draw(decades(-9, 3))
    final = draw(decades(-3, 3))
    initial = draw(zero_or(decades(-18, 0).map(lambda share: share * final)))
    softening = draw(zero_or(decades(-6, 6)))
    hardness = draw(decades(-3, 15))
    energy = 0.5 * values["density"] * volume(radius) * values["relative_speed"] ** 2
    if energy > 0.0 and softening < 100.0 and draw(st.sampled_from([True, True, False])):
        pressure = energy / (4.0 * math.pi * ratio * radius**3)
        hardness = (
            pressure
            / math.exp(softening)
            / draw(st.one_of(MARGINAL, decades(-1, 1), decades(-1, 1), decades(-3, 6)))
        )
    return {
        "restitution": "pressure",
        "duration": {"law": duration, "length_ratio": ratio},
        "contact_area": {"initial": initial, "final": final},
        "hardness": "arrhenius",
    }, {
        "hardness": hardness,
        "activation_energy": softening * R * thermal_values["temperature"],
    }


@st.composite
def aggregating(draw, escape, duration, friction, engine, own=False, integration="exact"):
    """Draw a scene with every submodel, at extremes that make any of them inert or dominant."""
    box, values, radius = draw(grains(1e6 if escape == "periodic" and not own else 10.0))
    heats, heat_values = draw(thermal(box, values, radius))
    laws, law_values = draw(pressure_laws(values, heat_values, radius, duration))
    scene = {
        **box,
        **heats,
        **laws,
        "escape": escape,
        "friction": friction,
        "heating": "own_energy" if own else "pair_split",
        "fragmentation": "own_energy" if own else "pair_energy",
        "engine": draw(engine(box)),
    }
    scene["cooling"]["integration"] = integration
    return Drawn(scene, {**values, **heat_values, **law_values}, draw(st.integers(0, 9)))


@st.composite
def bouncing(draw, escape, contact_time, engine):
    """Draw a scene of constant restitution with everything else at work."""
    box, values, radius = draw(grains(1e6 if escape == "periodic" else 10.0))
    heats, heat_values = draw(thermal(box, values, radius))
    restitution = {"law": "constant", "value": draw(st.sampled_from([1.0, 0.9, 0.1, 0.0]))}
    if contact_time:
        restitution["value"] = draw(st.sampled_from([1.0, 0.9, 0.1]))
        restitution["contact_time"] = box["end_time"] * draw(decades(-6, -3))
    scene = {
        **box,
        **heats,
        "escape": escape,
        "restitution": restitution,
        "friction": "constant",
        "heating": "pair_split",
        "fragmentation": "pair_energy",
        "engine": draw(engine(box)),
    }
    return Drawn(scene, {**values, **heat_values}, draw(st.integers(0, 9)))


def events(budget):
    return lambda box: st.just({"law": "event", "budget": budget})


def equal_steps(box):
    return st.one_of(st.integers(1, 5), st.integers(1, 200)).map(
        lambda steps: {"law": "fixed", "steps": steps}
    )


def adaptive_steps(box):
    def engine(drawn):
        floor = box["end_time"] * drawn[0]
        return {"law": "adaptive", "floor": floor, "ceiling": floor * drawn[1]}

    return st.tuples(decades(-3, 1), decades(0, 3)).map(engine)
