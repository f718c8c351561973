"""The scene that a map is made of, which each cell changes, and the file of a cell."""

import json
from collections.abc import Mapping
from dataclasses import replace
from typing import Any, NamedTuple

from agglom_mpi.accuracy.study import closed, with_values
from agglom_mpi.config.campaign import Campaign
from agglom_mpi.config.scene import SceneSection
from agglom_mpi.config.yaml_source import CampaignError, Problem
from agglom_mpi.declaration.reading import SOURCE_SHA256
from agglom_mpi.physics import scales
from agglom_mpi.search.objectives.growth import MaximumGrowth
from agglom_mpi.simulation.engines import EventDriven
from agglom_mpi.variables import TEN, volume_fraction

Values = Mapping[str, float]


class MapScene(NamedTuple):
    """One string of a campaign, at the centre of the planes.

    Attributes
    ----------
    section, values
        The scene of the string, and its variables in SI units, by name.
    centre
        The campaign of that string alone, of the greatest growth, with no more grains than a map
        has, and with the event engine.
    """

    section: SceneSection
    values: Values
    centre: Campaign

    @property
    def fraction(self) -> float:
        """Volume fraction of the grains."""
        return volume_fraction(self.values["size_ratio"], self.section.third_moment)

    @property
    def radius(self) -> float:
        """Mean radius of the grains in m."""
        return scales.grain_radius(self.section, self.values)

    @property
    def content(self) -> float:
        """Heat that a grain takes per temperature, J/K."""
        return scales.grain_mass(self.section, self.values) * self.values["heat_capacity"]

    @property
    def end_time(self) -> float:
        """End time in s."""
        return scales.end_time(self.section, self.values)

    def campaign(self, values: Values, **changes: object) -> Campaign:
        """Return the campaign with some variables and some entries of its scene replaced.

        Raises
        ------
        CampaignError
            If a value is impossible.
        """
        section = self.centre.scene.model_copy(update=changes)
        found = with_values(self.centre, section, {**self.values, **values})
        found.parameters(found.variables.used_values(found.variables.lower))
        return found


def map_scene(
    campaign: Campaign, settings: Mapping[str, Any], grains: int, budget: int
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
    changes: dict[str, object] = {
        "particles": number,
        "half_width": scales.half_width(section, values) * smaller,
        "grain_diameter": None,
        "grain_radius": None,
        "end_time": scales.end_time(section, values),
        "engine": EventDriven(budget=budget),
    }
    if section.cooling.by_steps:  # which the event engine does not take
        changes["cooling"] = section.cooling.model_copy(update={"integration": "exact"})
    alone = replace(campaign, objective=MaximumGrowth(), plan=None, user_function=None)
    centre = with_values(alone, section.model_copy(update=changes), values)
    return MapScene(section, values, centre)


def file_text(campaign: Campaign, title: str) -> str:
    """Return the text of a campaign file of a campaign's only string, as JSON, which is YAML."""
    values = TEN.values_by_name(campaign.parameters())
    scene = {
        key: _given(entry) if isinstance(entry, dict) else entry
        for key, entry in campaign.scene.entries().items()
    }
    variables = {name: value for name, value in values.items() if value == value}
    document = {"title": title, "seed": campaign.seed, "scene": scene, "variables": variables}
    return json.dumps(document, indent=1)


def _given(entry: Mapping[str, Any]) -> dict[str, Any]:
    """Return the entries of a law that a file gives: no digest, and nothing that is None."""
    return {
        name: value for name, value in entry.items() if name != SOURCE_SHA256 and value is not None
    }
