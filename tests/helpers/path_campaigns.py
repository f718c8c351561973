"""Campaigns whose strings have numbers of the scene, and the same with these in the scene."""

from agglom_mpi.config.campaign import Campaign

TEXT = """\
title: Numbers of the scene
seed: 3
scene:
{scene}
variables:
{variables}
objective: {{law: growth_target, ratio: 1.5}}
search: {{population: 8, parents: 4}}
ensemble: {{rule: fixed, samples: 3, common_configurations: {common}}}
stopping: {{generations: 3}}
"""

COLD = {
    "particles": "30",
    "half_width": "1 cm",
    "velocities": "{law: spread, mean: [0, 0, 0], transverse: 1}",
    "restitution": "{law: constant, value: 0.7}",
    "heating": "none",
    "end_time": "2 ms",
}
"""A scene without temperatures."""
COLD_VARIABLES = {"relative_speed": "[2, 9]", "size_ratio": "0.6", "density": "2500"}

HOT = {
    "particles": "30",
    "half_width": "1 cm",
    "velocities": "{law: spread, mean: [0, 0, 0], transverse: 1}",
    "restitution": "pressure",
    "hardness": "arrhenius",
    "heating": "pair_split",
    "cooling": "{law: radiation, emissivity: 0.5, surroundings: 250 K}",
    "end_time": "2 ms",
}
"""A scene whose grains bond and cool."""
HOT_VARIABLES = {
    "relative_speed": "[20, 60]",
    "size_ratio": "0.6",
    "density": "2500",
    "hardness": "1 MPa",
    "heat_capacity": "1000",
    "temperature": "350",
    "activation_energy": "500",
}


def text_of(scene: dict, variables: dict, common: bool = False, more: str = "") -> str:
    """Return the text of a campaign; an entry that is None is left out."""

    def lines(entries: dict) -> str:
        return "\n".join(f"  {k}: {v}" for k, v in entries.items() if v is not None)

    text = TEXT.format(scene=lines(scene), variables=lines(variables), common=str(common).lower())
    return text + more


def campaign_of(scene: dict, variables: dict, common: bool = False, more: str = "") -> Campaign:
    """Return the campaign of `text_of`."""
    return Campaign.from_text(text_of(scene, variables, common, more))


SIZED = text_of(
    COLD
    | {
        "restitution": "{law: constant, value: 0}",
        "sizes": "lognormal",
        "end_time": None,
    },
    {"relative_speed": "[2, 9]", "density": "2500", "volume_fraction": "[0.05, 0.15]"}
    | {"sizes.spread": "[1.1, 1.3]", "end_time": "[1 ms, 2 ms, log]"},
    more=(
        "derived: {spread_less_one: sizes.spread - 1}\n"
        "constraints: [sizes.spread > 1.12]\n"
        "final: {strings: 2, samples: 4}\n"
    ),
).replace("{law: growth_target, ratio: 1.5}", "maximum_growth")
"""A campaign with a volume fraction of its own, a constraint, and an objective of its grains.

Whatever touches merges. It takes a kernel that many tests share.
"""
