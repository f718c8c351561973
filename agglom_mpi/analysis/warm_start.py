"""Warm starts: what a search begins with of earlier campaigns, best strings or all samples."""

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from agglom_mpi.analysis.ranking import rank_strings
from agglom_mpi.config.campaign import Campaign
from agglom_mpi.config.own_components import permitted_modules
from agglom_mpi.config.yaml_source import CampaignError, Problem, parse
from agglom_mpi.formatting import pluralise
from agglom_mpi.outcome import COMPLETED
from agglom_mpi.search.ensemble import Ensemble
from agglom_mpi.search.proposals import Evaluations
from agglom_mpi.search.stopping import FixedNumber
from agglom_mpi.statistics import Floats
from agglom_mpi.storage.access import DamagedCampaign, NotACampaign
from agglom_mpi.storage.reader import (
    CampaignData,
    given_strings,
    read_campaign,
    read_inversion,
)
from agglom_mpi.storage.recorded_campaign import code_note
from agglom_mpi.storage.schema import (
    LEARNED_FAVOURS_LOW,
    LEARNED_FROM,
    LEARNED_SHA256,
    LEARNED_STRING,
    learned_schema,
    parameters_of,
)
from agglom_mpi.storage.table import fitted
from agglom_mpi.storage.verify import row_list

END_ROUNDING: Final = 1e-9
"""Distance beyond an end, relative to that end, that is only rounding of another spelling."""
MIN_STRINGS: Final = 2
"""Minimum number of different strings with a completed sample that a search can learn from."""
MAX_DIFFERENCES: Final = 4
"""Maximum number of differences that a message names."""
NEEDS_CODE: Final = (
    "needs code of one's own, which runs only if this campaign names the same module"
)
"""What is wrong with a file whose components may not run."""


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


class WarmStart(NamedTuple):
    """Strings that a search begins with, what it learns from, and what to warn of.

    Attributes
    ----------
    strings
        Shape (n, k), in SI units.
    warnings
        On better strings of the earlier campaign that are left out.
    learned
        Samples of another campaign; None: there is none.
    """

    strings: Floats
    warnings: tuple[Problem, ...] = ()
    learned: Learned | None = None


def warm_start(campaign: Campaign, output: Path | None = None) -> WarmStart:
    """Return the strings that a campaign is given to begin with, in its box, and what it learns.

    Strings of an earlier campaign that are not in the box, break a constraint or repeat one that
    ranks before them are left out, and those that follow take their places. Of code of one's own
    that the earlier file has, only modules that this campaign names, too, are executed.

    Parameters
    ----------
    campaign
        The campaign. The names of earlier files are relative to its own file.
    output
        Its own file. If it holds what they give already, the earlier files are not read.

    Raises
    ------
    CampaignError
        If an earlier file is no campaign, cannot be read, has too few strings or another scene, or
        is needed for a lost row and has other best strings by now.
    """
    start = _given_strings(campaign, output)
    name = campaign.search.learns_from
    if name is None:
        return start
    learned = stored_learning(output) if output is not None and output.exists() else None
    if learned is None:
        with _named(campaign, "learn_from", name) as path:
            learned = learn_from(campaign, path, start.strings)
    return start._replace(learned=learned)


def _given_strings(campaign: Campaign, output: Path | None) -> WarmStart:
    earlier = campaign.search.earlier
    if earlier is None:
        return WarmStart(campaign.given_strings())
    begun = None
    if output is not None and output.exists():
        begun = given_strings(read_campaign(output).string_rows())
        if len(begun) == earlier.strings:
            return WarmStart(parameters_of(begun))
    with _named(campaign, "start", earlier.file) as path:
        ranked = _ranked_strings(campaign, path)
        strings, left_out = _chosen(campaign, earlier.strings, *ranked)
        if begun is not None:
            _check_begun(begun, strings)
    warning = _problem(campaign, "start", f"leaves out strings of {path}: {left_out}")
    return WarmStart(strings, (warning,) if left_out else ())


@contextmanager
def _named(campaign: Campaign, key: str, name: str) -> Iterator[Path]:
    """Yield the path of an earlier file; what is wrong with it is a problem of a key of `search`.

    Raises
    ------
    CampaignError
    """
    path = Path(campaign.name).parent / name
    try:
        yield path
    except (NotACampaign, OSError, ValueError) as error:
        said = (isinstance(error, OSError) and error.strerror) or str(error)
        message = said if isinstance(error, NotACampaign) else f"{path}: {said}"
        if not path.exists() and Path(name).exists():
            message += "; the name is relative to the folder of the campaign file"
        raise CampaignError(_problem(campaign, key, message)) from None


def _problem(campaign: Campaign, key: str, message: str) -> Problem:
    """Return a problem of a key of `search`."""
    return parse(campaign.text, campaign.name).problem(("search", key), message)


def _ranked_strings(campaign: Campaign, path: Path) -> tuple[NDArray[np.int64], Floats]:
    """Return the judged strings of another campaign, ranked as in a report.

    They are numbers, (n,), and this campaign's variables, (n, k), nan where the other lacks one.
    """
    data = read_inversion(str(path), permitted_modules(campaign))
    if code_note(data):
        raise ValueError(NEEDS_CODE)
    strings, order = data.string_rows(), np.asarray(rank_strings(data).order, np.int64)
    parameters = parameters_of(strings[np.searchsorted(strings["string"], order)])
    return order, campaign.variables.of_other(parameters, data.variables)


def _chosen(
    campaign: Campaign, wanted: int, numbers: NDArray[np.int64], best: Floats
) -> tuple[Floats, str]:
    """Return the first ranked strings that a search can begin with, (wanted, k).

    The text names better ones that are left out. A ValueError is raised if there are too few.
    """
    strings, outside = _in_the_box(campaign, best)
    names = campaign.variables.names
    faults = {f"{name} out of range": outside[:, i] for i, name in enumerate(names)}
    faults["against the constraints"] = ~campaign.allowed_strings(strings)
    usable = ~np.any(list(faults.values()), axis=0)
    different = np.nan_to_num(strings[usable])  # nan: a variable that the scene does not use
    _, first = np.unique(different, axis=0, return_index=True)
    repeats = usable.copy()
    repeats[np.flatnonzero(usable)[first]] = False
    faults["the same as one before"] = repeats
    usable &= ~repeats
    taken = np.flatnonzero(usable)[:wanted]
    looked_at = len(numbers) if len(taken) < wanted else int(taken[-1]) + 1
    left_out = ", ".join(_faults_of(numbers[:looked_at], faults))
    if len(taken) < wanted:
        judged = pluralise(len(numbers), "judged string")
        if left_out:
            judged += f", of which {len(taken)} can be used (left out: {left_out})"
        raise ValueError(f"has {judged}; {wanted} are asked for")
    return strings[taken], left_out


def _faults_of(numbers: NDArray[np.int64], faults: dict[str, NDArray[np.bool_]]) -> Iterator[str]:
    """Yield texts on strings that have a fault, the first of several alone."""
    known = np.zeros(len(numbers), np.bool_)
    for fault, strings in faults.items():
        new = strings[: len(numbers)] & ~known
        known |= new
        if new.any():
            yield f"{row_list(numbers[new].tolist())} ({fault})"


def _in_the_box(campaign: Campaign, best: Floats) -> tuple[Floats, NDArray[np.bool_]]:
    """Return strings, (n, k), as the campaign has them, and which variables are out of range.

    What it fixes or does not use is as it says. A value beyond an end by rounding is that end.
    """
    strings, box = np.tile(campaign.parameters(), (len(best), 1)), campaign.variables
    known = (box.lower < box.upper) & np.isfinite(best)
    strings[known] = best[known]
    below = strings < box.lower - END_ROUNDING * np.abs(box.lower)
    outside = below | (strings > box.upper + END_ROUNDING * np.abs(box.upper))
    return np.clip(strings, box.lower, box.upper), outside


def _check_begun(begun: NDArray[np.void], strings: Floats) -> None:
    """Raise ValueError if the strings that a campaign began with are not those it would get now.

    The earlier campaign may have gone on since, or have new estimates of its best.
    """
    if not np.array_equal(parameters_of(begun), strings[begun["slot"]], equal_nan=True):
        lost = row_list(set(range(len(strings))) - set(begun["slot"].tolist()))
        raise ValueError(
            f"has other best strings now than this campaign began with, of which {lost} is lost"
        )


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
        raise ValueError(NEEDS_CODE)
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
