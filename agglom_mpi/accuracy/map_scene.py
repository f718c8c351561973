"""The scene that a map is made of: plain values of a campaign file, which each cell changes.

Every cell is a campaign of its own, read and checked like one, so that its text as a file is the
same scene to the last bit.
"""

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any, NamedTuple

from agglom_mpi.accuracy.study import closed
from agglom_mpi.config.campaign import Campaign
from agglom_mpi.config.own_components import BesideCampaign
from agglom_mpi.config.scene import SceneSection
from agglom_mpi.config.yaml_source import CampaignError, Problem
from agglom_mpi.declaration.reading import SOURCE_SHA256, Reading
from agglom_mpi.measurements.files.campaign_files import FilesBeside
from agglom_mpi.physics import scales
from agglom_mpi.simulation.engines import EventDriven
from agglom_mpi.variables import TEN, volume_fraction


class MapScene(NamedTuple):
    """One string of a campaign, at the centre of the planes.

    Attributes
    ----------
    section, values
        The scene of the string, and its variables in SI units, by name.
    document
        Section `scene` as plain values, with `half_width` and `end_time` in SI units.
    name, title, seed
        Of the campaign.
    reading
        Finds laws of one's own.
    radius, mass, end_time, collision_rate
        Of the grains, SI units.
    """

    section: SceneSection
    values: dict[str, float]
    document: dict[str, Any]
    name: str
    title: str
    seed: int
    reading: Reading
    radius: float
    mass: float
    end_time: float
    collision_rate: float

    @property
    def fraction(self) -> float:
        """Volume fraction of the grains."""
        return volume_fraction(self.values["size_ratio"], self.section.third_moment)

    def campaign(self, scene: Mapping[str, Any], values: Mapping[str, float]) -> Campaign:
        """Return the campaign with some entries of its scene and some variables replaced.

        An entry None takes its default.

        Raises
        ------
        CampaignError
            If such a scene is refused.
        """
        changed = {**self.document, **scene}
        given = {**self.values, **values}
        text = text_of(
            {key: entry for key, entry in changed.items() if entry is not None}, given, self.seed
        )
        return Campaign.from_text(text, self.name, None, self.reading)


def text_of(
    scene: Mapping[str, Any], values: Mapping[str, float], seed: int, title: str = ""
) -> str:
    """Return a campaign file of one string, as JSON, which is YAML; unused variables are nan."""
    variables = {name: value for name, value in values.items() if value == value}
    document = {"title": title, "seed": seed, "scene": scene, "variables": variables}
    return json.dumps(document, indent=1)


def file_text(campaign: Campaign, title: str) -> str:
    """Return the text of a campaign file with the only string of a campaign."""
    values = TEN.values_by_name(campaign.parameters())
    return text_of(plain_entries(campaign.scene), values, campaign.seed, title)


def plain_entries(section: SceneSection) -> dict[str, Any]:
    """Return a scene as plain values that a campaign file may have."""
    return {
        key: _given(entry) if isinstance(entry, dict) else entry
        for key, entry in section.entries().items()
    }


def _given(entry: Mapping[str, Any]) -> dict[str, Any]:
    """Return the entries of a law that a file gives: no digest, and nothing that is None."""
    return {
        name: value for name, value in entry.items() if name != SOURCE_SHA256 and value is not None
    }


def map_scene(
    campaign: Campaign, settings: Mapping[str, Any], grains: int, budget: int, allow_code: bool
) -> MapScene:
    """Return the scene that a map is made of.

    Parameters
    ----------
    campaign, settings
        The campaign, and the values of its variables that are not those of its string's centre.
    grains
        Maximum number of grains; the box of more is made smaller with them.
    budget
        Events per grain that the event engine may take.
    allow_code
        Whether laws of one's own may run.

    Raises
    ------
    CampaignError
        If a setting is wrong, or the scene gives sizes as lengths.
    """
    campaign, string = closed(campaign, campaign.parameters(settings))
    section, values = campaign.at(string)
    if section.sizes is not None and section.sizes.mean_diameter is not None:
        message = "are lengths; a map needs sizes relative to their mean, and half_width"
        raise CampaignError(Problem(campaign.name, None, "scene.sizes", message))
    number = min(section.particles, grains)
    smaller = (number / section.particles) ** (1.0 / 3.0)
    time = scales.end_time(section, values)
    document = plain_entries(section) | {
        "particles": number,
        "half_width": scales.half_width(section, values) * smaller,
        "end_time": time,
        "engine": EventDriven(budget=budget).entries(),
    }
    for key in ("grain_diameter", "grain_radius"):
        document.pop(key, None)
    folder = Path(campaign.name).parent
    return MapScene(
        section=section,
        values=dict(values),
        document=document,
        name=campaign.name,
        title=campaign.title,
        seed=campaign.seed,
        reading=Reading(own=BesideCampaign(folder, allow_code), files=FilesBeside(folder)),
        radius=scales.grain_radius(section, values),
        mass=scales.grain_mass(section, values),
        end_time=time,
        collision_rate=scales.collision_rate(section, values),
    )
