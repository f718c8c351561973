"""The libraries that some searches need and the package is installed without."""

from importlib.util import find_spec
from typing import Final

from agglom_mpi.config.campaign import Campaign
from agglom_mpi.config.yaml_source import CampaignError, Problem, parse

LIBRARIES: Final = {
    "surrogate": ("threadpoolctl",),
    "cmaes": ("cmaes",),
}
"""What a method needs."""


class MissingLibraryError(CampaignError):
    """A campaign cannot be run here."""


def check_libraries(campaign: Campaign) -> None:
    """Raise a MissingLibraryError unless all that the search needs is installed; loads nothing."""
    method = campaign.search.method
    missing = [name for name in LIBRARIES.get(method, ()) if find_spec(name) is None]
    if missing:
        line = parse(campaign.text, campaign.name).line(("search", "method"))
        message = (
            f"is {method!r}, but {' and '.join(missing)} cannot be found here; "
            "pip install 'agglom_mpi[search]'"
        )
        raise MissingLibraryError(Problem(campaign.name, line, "search.method", message))
