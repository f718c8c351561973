"""The campaign that a file records, and which code of one's own in it may run."""

from collections.abc import Callable
from typing import TYPE_CHECKING, Any, TypeVar

from agglom_mpi.declaration.components import UnknownComponentError
from agglom_mpi.declaration.reading import OWN_MODULES, SOURCE_SHA256, Reading, own_names
from agglom_mpi.errors import CodeNotAllowedError
from agglom_mpi.search.methods.method import SearchMethod
from agglom_mpi.search.objectives.objective import Objective

if TYPE_CHECKING:
    from agglom_mpi.config.campaign import Campaign
    from agglom_mpi.config.user_function import UserFunction
    from agglom_mpi.storage.reader import CampaignData

Recorded = TypeVar("Recorded")


def recorded_campaign(data: "CampaignData") -> "Campaign":
    """Return the campaign of a file, by its text, read once.

    A user's function is called only if it is the `allowed_function` of the file.

    Raises
    ------
    CampaignError
        If the text in the file is damaged.
    """
    return data.derived(_campaign)


def _campaign(data: "CampaignData") -> "Campaign":
    # Imported here: most files are reported without what reads a campaign's text.
    from agglom_mpi.config.census_layout import with_census_of
    from agglom_mpi.config.loading import campaign_of_record

    own, allowed = recorded_reading(data).own, allowed_function(data)
    text, name = data.campaign_text, str(data.path)
    campaign = campaign_of_record(text, name, data.identity, own, allowed)
    counts = campaign.data or campaign.experiments
    return with_census_of(campaign, data.sizes.census) if counts else campaign


def recorded_component(
    data: "CampaignData", section: str, of_entries: Callable[[dict[str, Any], Reading], Recorded]
) -> Recorded:
    """Return the component of a section by the identity in a file, without reading its text.

    `of_entries` is that of the base class.

    Raises
    ------
    UnknownComponentError
        If its name is unknown.
    """
    entries: dict[str, Any] = {}
    for path, value in data.identity.items():
        first, *keys = path.split(".")
        if first == section and keys:
            inner = entries
            for key in keys[:-1]:
                inner = inner.setdefault(key, {})
            inner[keys[-1]] = value
    return of_entries(entries, recorded_reading(data))


def recorded_search(data: "CampaignData") -> SearchMethod | None:
    """Return the search method; None if a file has none, or one of a later version."""
    try:
        # Numbers that are entries of their own suffice for what is asked of the method.
        entries = {key.removeprefix("search."): value for key, value in data.identity.items()}
        is_own = "search" in own_names(data.identity)
        reading = recorded_reading(data) if is_own else Reading(recorded=True)
        return SearchMethod.of_entries(entries, reading)
    except UnknownComponentError:
        return None


def recorded_objective(data: "CampaignData") -> Objective:
    """Return the objective of a campaign file.

    Raises
    ------
    UnknownComponentError
        If its name is unknown.
    """
    # Imported here: it loads what reads a campaign's text.
    from agglom_mpi.config.user_function import function_of_means

    objective = recorded_component(data, "objective", Objective.of_entries)
    return objective.with_code(function_of_means(allowed_function(data), objective.code_of_means))


def recorded_reading(data: "CampaignData") -> Reading:
    """Return how a campaign is read: as it was recorded, and with its own components.

    Raises
    ------
    CodeNotAllowedError
        If these may not be executed.
    """
    if data.reading is None:  # once, as it may execute modules
        require_code(data)
        data.reading = _reading(data)
    return data.reading


def _reading(data: "CampaignData") -> Reading:
    if OWN_MODULES not in data.attributes:
        return Reading(recorded=True)
    # Imported here: the others are read without what reads modules.
    from agglom_mpi.config.own_components import RecordedModules

    def may_run(file: str, sha256: str) -> bool:
        return _may_run(data, file, sha256)

    own = RecordedModules(data.attributes, data.identity, may_run, data.path.parent)
    return Reading(recorded=True, own=own)


def allowed_function(data: "CampaignData") -> "UserFunction | None":
    """Return the user's function of a campaign, where the file has its source and it may run."""
    if not data.allow_code or OWN_MODULES not in data.attributes:
        return None
    from agglom_mpi.config.own_components import recorded_source
    from agglom_mpi.config.user_function import recorded_function
    from agglom_mpi.declaration.own_modules import OwnModule

    function = recorded_function(data.identity)
    if function is None or not _may_run(data, *function.module[:2]):
        return None
    source = recorded_source(data.attributes, *function.module[:2])
    if source is None:
        return None
    own = OwnModule.of(function.module.file, source, data.path.parent)
    return function._replace(module=own._replace(values=function.module.values))


def _may_run(data: "CampaignData", file: str, sha256: str) -> bool:
    allowed = data.allow_code
    return allowed if isinstance(allowed, bool) else (file, sha256) in allowed


def code_note(data: "CampaignData") -> str:
    """Return a line on code of one's own that may not run; then a file is its tables alone.

    It is empty of a campaign without such code, and where that may run.
    """
    return data.derived(_code_note)


def _code_note(data: "CampaignData") -> str:
    of_means = data.identity.get("objective.of_means")
    named = own_names(data.identity) | ({} if of_means is None else {"objective": of_means})
    refused = [
        name
        for section, name in named.items()
        if not _may_run(
            data,
            f"{name.partition(':')[0].removesuffix('.py')}.py",
            str(data.identity.get(f"{section}.{SOURCE_SHA256}")),
        )
    ]
    if refused:
        return f"{data.path} has code of its own ({', '.join(refused)}); --allow-code runs it"
    if of_means is not None and allowed_function(data) is None:
        return f"{data.path} has code of its own ({of_means}), but not the source with its digest"
    return ""


def require_code(data: "CampaignData") -> None:
    """Raise a CodeNotAllowedError if the campaign has code of its own that may not run."""
    if note := code_note(data):
        raise CodeNotAllowedError(note)
