"""Whether the laws of a scene take together the numbers at the ends of a box."""

from collections.abc import Iterator
from itertools import groupby, product
from typing import TYPE_CHECKING, Final

import numpy as np
import numpy.typing as npt

from agglom_mpi.config.yaml_source import CampaignError, Problem, parse
from agglom_mpi.declaration.declared import FieldPath
from agglom_mpi.declaration.given_values import JAMMING_FRACTION
from agglom_mpi.formatting import in_unit
from agglom_mpi.variables import volume_fraction

if TYPE_CHECKING:
    from agglom_mpi.config.bounds import Bounds
    from agglom_mpi.config.campaign_sections import CampaignSections

MAX_TOGETHER: Final = 8
"""Numbers of one law whose ends are combined: 256 strings, a tenth of a second."""


def check_ends(campaign: "CampaignSections") -> None:
    """Raise a CampaignError if the scene of a string at the ends of the box is refused.

    These are all lower ends, all upper ends, and the ends of one number of the scene with all else
    in the middle. Strings that break a constraint are left out, as no search proposes them.
    """
    if not campaign.variables.paths:
        return
    if problems := _refused(campaign) or dict(_out_of_reach(campaign)):
        source = parse(campaign.text, campaign.name)
        raise CampaignError(*(source.problem(*found) for found in problems.items()))


def refused_corners(campaign: "CampaignSections") -> list[Problem]:
    """Return a warning of each law that refuses some ends of its numbers together."""
    found: list[tuple[FieldPath, str]] = []
    for names, strings in _corners(campaign):
        refusals = ((string, _refusal(campaign, string)) for string in strings)
        string, message = next(((s, m) for s, m in refusals if m), (None, ""))
        if string is not None:
            reached = " and ".join(f"{name} {_value(campaign, name, string)}" for name in names)
            text = f"reaches {reached}, where {message}; samples fail there; constraints exclude it"
            found.append((("variables", names[0]), text))
    if not found:
        return []
    source = parse(campaign.text, campaign.name)
    return [source.problem(*each) for each in found]


def _refused(campaign: "CampaignSections") -> dict[FieldPath, str]:
    """Return why strings at ends of the box have no scene, by the field that it is reported at."""
    problems: dict[FieldPath, str] = {}
    for name, string in _ends(campaign):
        path = ("variables", name)
        if path not in problems and (message := _refusal(campaign, string)):
            problems[path] = _reaches(campaign, name, string, message)
    if problems:
        return problems
    for string in (campaign.variables.lower, campaign.variables.upper):
        if message := _refusal(campaign, string):
            name = _taking_part(campaign, string)
            return {("variables", name): _reaches(campaign, name, string, message)}
    return {}


def _refusal(campaign: "CampaignSections", string: npt.NDArray[np.float64]) -> str:
    """Return why a string, (k,), has no scene; empty if it has one, or is never proposed."""
    return _problem(campaign, string) if campaign.allowed_strings(string[None])[0] else ""


def _taking_part(campaign: "CampaignSections", string: npt.NDArray[np.float64]) -> str:
    """Return a searched number of the scene without whose end a string, (k,), has a scene."""
    box, names = campaign.variables, _searched(campaign)
    for name in names:
        moved, place = np.array(string), box.table.index(name)
        moved[place] = box.at(0.5)[place]
        if not _problem(campaign, moved):
            return name
    return names[0]


def _reaches(
    campaign: "CampaignSections", name: str, string: npt.NDArray[np.float64], message: str
) -> str:
    return f"reaches {_value(campaign, name, string)}, where {message}"


def _value(campaign: "CampaignSections", name: str, string: npt.NDArray[np.float64]) -> str:
    """Return the value of a variable in a string, (k,), with its unit."""
    table = campaign.variables.table
    return in_unit(f"{string[table.index(name)]:g}", table[name].unit)


def _out_of_reach(campaign: "CampaignSections") -> Iterator[tuple[FieldPath, str]]:
    """Yield the objective if it wants more growth than the grains of any string allow."""
    wanted = campaign.objective.wanted_growth
    if wanted is None or not campaign.scenes.sizes_differ:
        return
    (field, ratio), largest = wanted, campaign.most_grains ** (1.0 / 3.0)
    if field and ratio > largest:
        grains = f"{campaign.scene.particles} grains in one"
        yield ("objective", *field), f"is {ratio:g}; {grains} give at most {largest:.4g}"


def _searched(campaign: "CampaignSections") -> list[str]:
    """Return the names of the numbers of the scene that are searched."""
    box = campaign.variables
    return [path.name for path in box.paths if path.name in box.searched]


def _ends(campaign: "CampaignSections") -> Iterator[tuple[str, npt.NDArray[np.float64]]]:
    """Yield strings with one number of the scene at an end, (k,), each with its name."""
    box = campaign.variables
    for name in _searched(campaign):
        place = box.table.index(name)
        for end in (box.lower, box.upper):
            string = box.at(0.5)
            string[place] = end[place]
            yield name, string


def _corners(
    campaign: "CampaignSections",
) -> Iterator[tuple[list[str], Iterator[npt.NDArray[np.float64]]]]:
    """Yield searched numbers of each law, and strings, (k,), with all their ends combined."""
    box = campaign.variables
    for _, paths in groupby(box.paths, key=lambda path: path.section):
        names = [path.name for path in paths if path.name in box.searched][:MAX_TOGETHER]
        if len(names) > 1:
            yield names, _combined(box, [box.table.index(name) for name in names])


def _combined(box: "Bounds", places: list[int]) -> Iterator[npt.NDArray[np.float64]]:
    for ends in product((box.lower, box.upper), repeat=len(places)):
        string = box.at(0.5)
        for place, end in zip(places, ends, strict=True):
            string[place] = end[place]
        yield string


def _problem(campaign: "CampaignSections", string: npt.NDArray[np.float64]) -> str:
    """Return why a string, (k,), has no scene; empty if it has one."""
    try:
        section, values = campaign.at(string)
    except ValueError as error:
        return str(error)
    fraction = volume_fraction(values["size_ratio"], section.third_moment)
    if fraction > JAMMING_FRACTION * (1.0 + 1e-9):
        return (
            f"the grains fill {fraction:.3g} of the box; random placement jams near "
            f"{JAMMING_FRACTION}"
        )
    return ""
