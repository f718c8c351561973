"""Samples of another campaign with the same scene, which a search learns from."""

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from agglom_mpi.config.campaign import Campaign
from agglom_mpi.config.own_components import permitted_modules
from agglom_mpi.formatting import pluralise
from agglom_mpi.outcome import COMPLETED
from agglom_mpi.search.ensemble import Ensemble
from agglom_mpi.search.proposals import Evaluations
from agglom_mpi.search.stopping import FixedNumber
from agglom_mpi.statistics import Floats
from agglom_mpi.storage.access import DamagedCampaign
from agglom_mpi.storage.reader import CampaignData, read_campaign, read_inversion
from agglom_mpi.storage.recorded_campaign import code_note
from agglom_mpi.storage.schema import (
    LEARNED_FAVOURS_LOW,
    LEARNED_FROM,
    LEARNED_SHA256,
    LEARNED_STRING,
    learned_schema,
)
from agglom_mpi.storage.table import fitted

MIN_STRINGS: Final = 2
"""Minimum number of different strings with a completed sample that a search can learn from."""
MAX_DIFFERENCES: Final = 4
"""Maximum number of differences that a message names."""


class Learned(NamedTuple):
    """Samples of another campaign.

    Attributes
    ----------
    rows
        Rows of `/learned`, shape (n,).
    attributes
        Attributes of a new file on where they are from.
    sources
        Digest of the sources that simulated them; empty of samples that a file has already.
    """

    rows: NDArray[np.void]
    attributes: Mapping[str, Any] = {}
    sources: str = ""


def stored_learning(output: Path) -> Learned | None:
    """Return the samples that a file has of another campaign; None if it has none.

    Raises
    ------
    DamagedCampaign
        If some of them are lost.
    """
    data = read_campaign(output)
    rows = data.learned_rows()
    if rows is None:
        return None
    if lost := data.sizes.learned - len(rows):
        what = f"a damaged campaign file: {pluralise(lost, 'row')} of /learned lost"
        raise DamagedCampaign(f"{output}: {what}")
    return Learned(rows)


def learn_from(campaign: Campaign, path: Path, given: Floats) -> Learned:
    """Return all samples of a campaign file that a campaign with the same scene can use.

    Samples of a string that the campaign is given to begin with, (n, k), are left out: with the
    same seed it would simulate them again.

    Raises
    ------
    ValueError
        If the scene is another one, or the samples do not suffice; the text follows a file's name.
    NotACampaign, OSError
        If the file is no campaign, or cannot be read.
    """
    # Imported here: it loads SciPy, which other campaigns do not need at their start.
    from agglom_mpi.inference.stored_samples import counted_samples, favours_low_objectives

    data = read_inversion(path, permitted_modules(campaign))
    if data.altered:
        raise ValueError(f"is damaged ({', '.join(data.altered)} altered)")
    if different := list(_differences(campaign, data)):
        shown = "; ".join(different[:MAX_DIFFERENCES])
        what = f"has {pluralise(len(different), 'difference')} from this campaign in what samples"
        raise ValueError(f"{what} rest on; must have none: {shown}")
    if code_note(data):
        what = "needs code of one's own, which runs only if this campaign names the same module"
        raise ValueError(what)
    strings, rows, place = counted_samples(data)
    variables = campaign.variables
    schema = learned_schema(variables, campaign.sample_quantities, campaign.census)
    found = fitted(rows, schema.dtype)
    found[LEARNED_STRING] = variables.of_other(strings, data.variables)[place]
    begun = {string.tobytes() for string in np.nan_to_num(given)}
    kept = [each.tobytes() not in begun for each in np.nan_to_num(found[LEARNED_STRING])]
    found = found[np.array(kept, np.bool_)]
    completed = np.nan_to_num(found[LEARNED_STRING][found["state"] == COMPLETED])
    if (usable := len(np.unique(completed, axis=0))) < MIN_STRINGS:
        raise ValueError(
            f"has completed samples of {pluralise(usable, 'string')} to learn from; must be at "
            f"least {MIN_STRINGS}"
        )
    attributes = {
        LEARNED_FROM: str(campaign.search.learns_from),
        LEARNED_SHA256: data.attributes["campaign_sha256"],
        LEARNED_FAVOURS_LOW: int(favours_low_objectives(data)),
    }
    return Learned(found, attributes, data.last_sources)


def evaluated(campaign: Campaign, rows: NDArray[np.void] | None) -> Evaluations | None:
    """Return what the objective of a campaign makes of rows of `/learned`, each string once."""
    if rows is None:
        return None
    keys = np.nan_to_num(rows[LEARNED_STRING])
    _, first, which = np.unique(keys, axis=0, return_index=True, return_inverse=True)
    order, strings = np.argsort(which.ravel(), kind="stable"), rows[LEARNED_STRING][first]
    groups = np.split(order, np.cumsum(np.bincount(which.ravel()))[:-1])
    objective, found = campaign.objective, []
    for string, group in zip(strings, groups, strict=True):
        rule = FixedNumber(samples=len(group))
        ensemble = Ensemble(rule, campaign.objective_at(string), campaign.scene.particles)
        for summary in objective.summaries(rows[group]):
            if not ensemble.finished:  # too many failed samples end it
                ensemble.add(summary)
        result = ensemble.result()
        signed = objective.signed(result.objective, result.mean_radius_ratio)
        found.append((result.objective, signed, ensemble.completed))
    objectives, deviations, samples = np.array(found).T
    numbers = np.arange(len(strings))
    return Evaluations(numbers, strings, objectives, deviations, samples.astype(np.int64))


def _differences(campaign: Campaign, data: CampaignData) -> Iterator[str]:
    """Yield what keeps samples of another campaign from being samples of this one."""
    asked, held = campaign.identity(), data.identity
    if campaign.objective.code is None:
        asked, held = (
            {key: value for key, value in each.items() if not key.startswith("objective.")}
            for each in (asked, held)
        )
    here, there = dict(_of_samples(asked)), dict(_of_samples(held))
    for key in sorted(here.keys() | there.keys()):
        if here.get(key) != there.get(key):
            what = (each.get(key, "nothing") for each in (there, here))
            yield f"{key}: {' there, '.join(map(str, what))} here"
    if campaign.census is not None and campaign.census != data.sizes.census:
        yield "data: other times or size classes"
    if held.get("ensemble.common_configurations"):
        yield "ensemble.common_configurations: true there, so that its samples are correlated"


def _of_samples(identity: Mapping[str, Any]) -> Iterator[tuple[str, Any]]:
    """Yield the entries of an identity that decide samples; ends of what is searched do not."""
    for key, value in identity.items():
        start, section = "", key
        if key.startswith("experiments."):
            _, name, section = key.split(".", 2)
            start = f"experiments.{name}."
        if section.startswith("variables."):
            variable, _, end = key.rpartition(".")
            is_searched = identity[f"{variable}.0"] != identity[f"{variable}.1"]
            if end == "0":
                yield variable, "searched" if is_searched else value
            elif end == "2":
                yield f"{variable}.scale", value
        elif section.startswith(("scene.", "objective.")) or key.startswith("experiment_names"):
            yield f"{start}{section}", value
