"""Warm starts: what a search begins with of earlier campaigns, best strings or all samples."""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from agglom_mpi.analysis.learning import Learned, learn_from, stored_learning
from agglom_mpi.analysis.ranking import rank_strings
from agglom_mpi.config.campaign import Campaign
from agglom_mpi.config.own_components import permitted_modules
from agglom_mpi.config.yaml_source import CampaignError, Problem, parse
from agglom_mpi.formatting import pluralise
from agglom_mpi.statistics import Floats
from agglom_mpi.storage.access import NotACampaign
from agglom_mpi.storage.reader import (
    given_strings,
    read_campaign,
    read_inversion,
)
from agglom_mpi.storage.recorded_campaign import code_note
from agglom_mpi.storage.schema import parameters_of
from agglom_mpi.storage.verify import row_list

END_ROUNDING: Final = 1e-9
"""Distance beyond an end, relative to that end, that is only rounding of another spelling."""


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
        what = "needs code of one's own, which runs only if this campaign names the same module"
        raise ValueError(what)
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
    faults["the same as one before"] = usable & ~_first_of_equals(strings, usable)
    usable &= ~faults["the same as one before"]
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


def _first_of_equals(strings: Floats, usable: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Return which strings, (n, k), are no copies of a usable one before them, (n,)."""
    seen = set[bytes]()
    first = np.zeros(len(strings), np.bool_)
    for i in np.flatnonzero(usable).tolist():
        first[i] = (key := strings[i].tobytes()) not in seen
        seen.add(key)
    return first


def _check_begun(begun: NDArray[np.void], strings: Floats) -> None:
    """Raise ValueError if the strings that a campaign began with are not those it would get now.

    The earlier campaign may have gone on since, or have new estimates of its best.
    """
    if not np.array_equal(parameters_of(begun), strings[begun["slot"]], equal_nan=True):
        lost = row_list(set(range(len(strings))) - set(begun["slot"].tolist()))
        raise ValueError(
            f"has other best strings now than this campaign began with, of which {lost} is lost"
        )
