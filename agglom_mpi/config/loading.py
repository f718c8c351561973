"""A campaign from its file, with the user's function that its objective may name."""

import os
from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

from agglom_mpi.config.campaign import Campaign
from agglom_mpi.config.own_components import ONLY_ALLOWED, BesideCampaign
from agglom_mpi.config.user_function import (
    UserFunction,
    load_function,
    read_function,
    recorded_function,
)
from agglom_mpi.config.yaml_source import read_text
from agglom_mpi.declaration.own_modules import executed
from agglom_mpi.declaration.reading import NO_OWN, OwnComponents, Reading
from agglom_mpi.measurements.files.campaign_files import FilesBeside, RecordedFiles


def load_campaign(path: str | os.PathLike[str], allow_code: bool = False) -> Campaign:
    """Read and validate a campaign file; see `campaign_runs.load_campaign`."""
    name = os.fspath(path)
    campaign = _campaign(name, allow_code)
    if campaign.objective.code is not None and not allow_code:
        raise campaign.function_error(f"is {campaign.objective.code!r}, {ONLY_ALLOWED}")
    return _with_function(campaign, load_function)


def check_campaign(path: str | os.PathLike[str], allow_code: bool = False) -> Campaign:
    """Read and validate a campaign file; its user function can be called only if allowed."""
    if allow_code:
        return load_campaign(path, allow_code)
    name = os.fspath(path)
    campaign = _with_function(_campaign(name, allow_code=False))
    function = campaign.user_function
    return (
        campaign if function is None else replace(campaign, user_function=function.without_source)
    )


def _campaign(name: str, allow_code: bool) -> Campaign:
    folder = Path(name).parent
    reading = Reading(own=BesideCampaign(folder, allow_code), files=FilesBeside(folder))
    return Campaign.from_text(read_text(name), name, None, reading)


def campaign_of_record(
    text: str,
    name: str,
    identity: Mapping[str, Any],
    own: OwnComponents = NO_OWN,
    allowed: UserFunction | None = None,
) -> Campaign:
    """Return a stored campaign; what its text names other files for is in its identity.

    `own` finds components of one's own. A user's function can be called only if it is given as
    `allowed`.

    Raises
    ------
    CampaignError
        If the text is damaged.
    """
    method = str(identity.get("search.method", ""))
    reading = Reading(True, own, files=RecordedFiles(identity), search_method=method)
    return Campaign.from_text(text, name, allowed or recorded_function(identity), reading)


def _with_function(
    campaign: Campaign, check: Callable[[UserFunction], object] = lambda function: None
) -> Campaign:
    """Add the source of the function that the objective names, if it does, and `check` it."""
    code = campaign.objective.code
    if code is None:
        return campaign
    try:
        function = read_function(Path(campaign.name).parent, code)
        check(function)
    except ValueError as error:
        raise campaign.function_error(str(error)) from None
    if of_means := campaign.objective.code_of_means:
        try:
            check(function._replace(call=of_means))
        except ValueError as error:
            raise campaign.function_error(str(error), "of_means") from None
    if check is load_function:
        values = executed(function.module).own.values or None
        function = function._replace(module=function.module._replace(values=values))
    return replace(campaign, user_function=function)
