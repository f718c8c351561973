"""Checks of the box of a campaign: its ends, constraints, given strings, and what searches it.

The share that constraints allow is that of random strings.
"""

import logging
import math
from collections.abc import Iterable, Iterator
from functools import lru_cache
from itertools import groupby, product
from typing import TYPE_CHECKING, Final, NamedTuple

import numpy as np
import numpy.typing as npt

from agglom_mpi.config.yaml_source import CampaignError, MissingSearchLibraryError, Problem, parse
from agglom_mpi.declaration.declared import FieldPath
from agglom_mpi.declaration.given_values import JAMMING_FRACTION
from agglom_mpi.errors import MissingLibraryError, require_library
from agglom_mpi.formatting import format_digits, in_unit
from agglom_mpi.physics import scales
from agglom_mpi.random_streams import ALLOWED_SHARE, search_stream
from agglom_mpi.search.space import SearchSpace
from agglom_mpi.variables import VariableTable, size_ratio, volume_fraction

if TYPE_CHECKING:
    from agglom_mpi.config.campaign import Campaign

LEAST_SHARE: Final = 1e-4
"""Share below which a campaign is refused: to propose a string takes too long."""
SMALL_SHARE: Final = 1e-2
"""Share below which there is a warning."""

STRINGS: Final = 1 << 14
"""Random strings of a first estimate."""
MORE_STRINGS: Final = 1 << 18
"""Random strings if the first estimate rests on less than `FEW` allowed ones."""
FEW: Final = 400


class AllowedShare(NamedTuple):
    """The share of n random strings of the box that satisfy all constraints.

    Strings are uniform in the coordinates in which the box is searched.
    """

    allowed: int
    strings: int

    @property
    def value(self) -> float:
        """The share."""
        return self.allowed / self.strings

    @property
    def error(self) -> float:
        """Its standard error."""
        return math.sqrt(self.value * (1.0 - self.value) / self.strings)

    def __str__(self) -> str:
        if not self.allowed:
            return f"no string of {self.strings:,}"
        percent = format_digits(100.0 * self.value, 3)
        return f"{percent} % (± {format_digits(100.0 * self.error, 1)} %)"


@lru_cache(1)  # a command asks several times for the campaign that it is about
def allowed_share(campaign: "Campaign") -> AllowedShare:
    """Return the share of the box that a campaign's constraints allow."""
    space = SearchSpace.of(campaign.variables)
    if not space.dimensions:
        return AllowedShare(
            int(campaign.allowed_strings(campaign.variables.at(0.5)[None]).sum()), 1
        )
    random = search_stream(campaign.seed, ALLOWED_SHARE)

    def count(strings: int) -> int:
        points = random.random((strings, space.dimensions))
        return int(np.count_nonzero(campaign.allowed_strings(space.from_unit(points))))

    share = AllowedShare(count(STRINGS), STRINGS)
    if share.allowed >= FEW:
        return share
    return AllowedShare(share.allowed + count(MORE_STRINGS - STRINGS), MORE_STRINGS)


LOG: Final = logging.getLogger(__name__)


def check_start(campaign: "Campaign", strings: npt.NDArray[np.float64]) -> None:
    """Raise a CampaignError if strings that `search.start` lists, (n, k), break a constraint."""
    table, problems = campaign.variables, []
    for i, string in enumerate(strings):
        columns = table.columns_by_name(string[None])
        for broken in campaign.relations.broken(campaign.scenes, columns):
            message = f"does not satisfy the constraint '{broken}'"
            problems.append((("search", "start", i), message))
    if problems:
        source = parse(campaign.text, campaign.name)
        raise CampaignError(*(source.problem(*found) for found in problems))


def check_given_strings(
    strings: list[dict[str, float]], box: VariableTable
) -> list[tuple[FieldPath, str]]:
    """Return problems of given strings: values not searched or outside the box, duplicates.

    Parameters
    ----------
    strings
        Values in SI units by name.
    box
        The variables of the campaign with their ranges.
    """
    problems: list[tuple[FieldPath, str]] = []
    for i, string in enumerate(strings):
        if string in strings[:i]:  # equal strings have equal samples, so that nothing is learnt
            problems.append((("start", i), "is the same string as one before it"))
        for name, value in string.items():
            entry, own = box[name], box.as_named(box[name])
            path = ("start", i, own.name)
            if not entry.is_searched:
                problems.append((path, "is not searched; give values of variables with a range"))
            elif not entry.lower <= value <= entry.upper:
                [given] = own.of_components(np.array([value]))
                message = f"is {given:g}; must be within its range, {own.lower:g} to {own.upper:g}"
                problems.append((path, message))
    return problems


def check_searchable(campaign: "Campaign") -> list[Problem]:
    """Return warnings about constraints that allow little of the box.

    Raises
    ------
    CampaignError
        Unless a variable is a range, and constraints leave enough to be searched.
    """
    if campaign.plan is None or not campaign.variables.searched:
        raise campaign.search_error()
    if not campaign.relations.constraints:
        return []
    share = allowed_share(campaign)
    if share.value >= SMALL_SHARE:
        return []
    source, path = parse(campaign.text, campaign.name), ("constraints",)
    if share.value < LEAST_SHARE:
        message = f"allow {share} of the box; must allow at least {LEAST_SHARE:.2%} of it"
        raise CampaignError(source.problem(path, message))
    message = f"allow {share} of the box; a narrower box is searched better"
    return [source.problem(path, message)]


def log_narrow(campaign: "Campaign") -> None:
    """Log the warnings of `check_searchable`, for what has no other place for them."""
    for problem in check_searchable(campaign):
        LOG.warning("warning: %s", problem)


def check_search_library(campaign: "Campaign") -> None:
    """Raise a MissingSearchLibraryError unless the search's library is installed."""
    search = campaign.search
    if search.library is None:
        return
    try:
        require_library(search.library, "search", f"{search.name} searches")
    except MissingLibraryError as error:
        message = f"is {search.name!r}; {error}"
        problem = parse(campaign.text, campaign.name).problem(("search", "method"), message)
        raise MissingSearchLibraryError(problem) from None


MAX_TOGETHER: Final = 8
"""Numbers of one law whose ends are combined: 256 strings, a tenth of a second."""

Corner = tuple[list[str], npt.NDArray[np.float64]]
"""Names of numbers of the scene, and a string, (k,), with these at ends of their ranges."""


def check_ends(campaign: "Campaign") -> None:
    """Raise a CampaignError if the scene of a string at the ends of the box is refused.

    These are the ends of one number of the scene with all else in the middle, all lower ends, and
    all upper ends. Strings that break a constraint are left out, as no search proposes them. So is
    a campaign that wants more growth than the grains of any string allow.
    """
    box, names = campaign.variables, _searched(campaign)
    ends = [*names, "size_ratio"]
    problems = _refused(campaign, (each for name in ends for each in _ends(campaign, [name])))
    whole = ((ends, string) for string in (box.lower, box.upper))
    if problems := problems or _refused(campaign, whole) or dict(_out_of_reach(campaign)):
        source = parse(campaign.text, campaign.name)
        raise CampaignError(*(source.problem(*found) for found in problems.items()))


def refused_corners(campaign: "Campaign") -> list[Problem]:
    """Return a warning of each law that refuses some ends of its numbers together."""
    problems: dict[FieldPath, str] = {}
    for _, group in groupby(_searched(campaign), key=lambda name: name.split(".")[0]):
        names = list(group)[:MAX_TOGETHER]
        if len(names) > 1:
            problems |= _refused(campaign, _ends(campaign, names))
    if not problems:
        return []
    source, more = parse(campaign.text, campaign.name), "samples fail there; constraints exclude it"
    return [source.problem(path, f"{message}; {more}") for path, message in problems.items()]


def _searched(campaign: "Campaign") -> list[str]:
    return [name for name in campaign.variables.of_scene if campaign.variables[name].is_searched]


def _ends(campaign: "Campaign", names: list[str]) -> Iterator[Corner]:
    """Yield strings with all ends of some numbers combined, and all else in the middle."""
    box = campaign.variables
    places = [box.index(name) for name in names]
    for ends in product((box.lower, box.upper), repeat=len(names)):
        string = box.at(0.5)
        for place, end in zip(places, ends, strict=True):
            string[place] = end[place]
        yield names, string


def _refused(campaign: "Campaign", corners: Iterable[Corner]) -> dict[FieldPath, str]:
    """Return why strings at ends have no scene, by the field of the number that is named."""
    box, problems = campaign.variables, dict[FieldPath, str]()
    for names, string in corners:
        if not campaign.allowed_strings(string[None])[0] or not (why := _problem(campaign, string)):
            continue
        # A law begins with the number that it refuses; jamming depends on sizes alone.
        sizes = [name for name in names if name.startswith("sizes.")]
        name = next(n for n in [why.split()[0], *sizes, *names] if n in names)
        if ("variables", name) not in problems:
            reached = in_unit(f"{string[box.index(name)]:g}", box[name].unit)
            problems["variables", name] = f"reaches {reached}, where {why}"
    return problems


def _out_of_reach(campaign: "Campaign") -> Iterator[tuple[FieldPath, str]]:
    field, ratio = campaign.objective.wanted_growth or ((), 0.0)
    largest = campaign.most_grains ** (1.0 / 3.0)
    if field and ratio > largest:
        grains = f"{campaign.scene.particles} grains in one"
        yield ("objective", *field), f"is {ratio:g}; {grains} give at most {largest:.4g}"


def _problem(campaign: "Campaign", string: npt.NDArray[np.float64]) -> str:
    """Return why a string, (k,), has no scene; empty if it has one."""
    try:
        section, values = campaign.at(string)
    except ValueError as error:
        return str(error)
    fraction = volume_fraction(values["size_ratio"], section.third_moment)
    if fraction > JAMMING_FRACTION * (1.0 + 1e-9):
        limit = f"random placement jams near {JAMMING_FRACTION}"
        most = size_ratio(JAMMING_FRACTION, section.third_moment)
        return f"the grains fill {fraction:.3g} of the box; {limit}, at a size_ratio of {most:.4g}"
    return ""


def check_scales(campaign: "Campaign", string: npt.NDArray[np.float64]) -> None:
    """Raise a CampaignError if a string, (k,), gives a grain mass or end time out of range."""
    try:
        section, values = campaign.at(string)
    except ValueError as error:
        raise CampaignError(Problem(campaign.name, None, "scene", str(error))) from None
    problems = []
    for key, measure in (
        (section.size_key, scales.grain_mass),
        ("end_time", scales.end_time),
    ):
        try:
            measure(section, values)
        except ValueError as error:
            place = ("variables" if key in campaign.variables else "scene", key)
            problems.append(parse(campaign.text, campaign.name).problem(place, str(error)))
    if problems:
        raise CampaignError(*problems)
