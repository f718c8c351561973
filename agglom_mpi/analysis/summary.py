"""Summary of a campaign: the numbers of `agglom report`, and its table."""

import json
from collections.abc import Mapping, Sequence
from typing import Any, Final, NamedTuple

import numpy as np
from rich.console import Group, RenderableType

from agglom_mpi.analysis.best_strings import best_table, collect_best
from agglom_mpi.analysis.comparison import PairedSamples
from agglom_mpi.analysis.data_fit import describe_fit
from agglom_mpi.analysis.derived import derived_columns
from agglom_mpi.analysis.estimates import objective_of, rounding_of, unconverged
from agglom_mpi.analysis.failed_samples import failure_lines, no_result, state_lines
from agglom_mpi.analysis.finite_size import describe_finite_size
from agglom_mpi.analysis.ranking import listed_strings, rank_strings, ranks_itself
from agglom_mpi.analysis.selection_bias import SelectionBias, describe_bias, selection_bias
from agglom_mpi.formatting import format_duration, pluralise, without_nan
from agglom_mpi.outcome import FAILED
from agglom_mpi.storage.lock import live_status
from agglom_mpi.storage.reader import CampaignData


class Summary(NamedTuple):
    """The numbers of `agglom report`, whose names are the keys of its JSON."""

    file: str
    title: str
    state: str
    reason: str
    no_result: str
    """Why no string has a result; empty where one has."""
    generations: int
    strings: int
    samples_used: int
    samples_simulated: int
    samples_fresh: int
    samples_in_larger_volumes: int
    failed: int
    hit_maximum: int
    not_converged: int
    """Strings of `hit_maximum` whose samples differ by more than rounding."""
    damaged: int
    seconds: float
    samples_per_second: float
    derived: dict[str, str]
    """SI units of the derived columns in `best`, by name."""
    best: list[dict[str, Any]]
    verdict: SelectionBias | None
    further: dict[str, str]
    """SI units of the variables beside those of the papers, by name."""


def collect_summary(file: CampaignData, best: int = 6) -> Summary:
    """Return the summary of a campaign file, finished or not.

    Parameters
    ----------
    file
        The campaign.
    best
        Number of the best strings to include. Each has a `reestimate` on its fresh samples, None if
        it has none.
    """
    results, legs, status = file.result_rows(), file.legs(), live_status(file)
    samples = file.all_sample_rows()
    fresh = int((samples["sample"] >= file.fresh_from).sum())
    generations = file.generation_rows()
    whole = legs[np.isfinite(legs["stopped"])]
    seconds = float((whole["stopped"] - whole["started"]).sum())
    if len(whole) < len(legs) and len(generations):
        seconds = max(seconds, float(generations["seconds"].max()))
    return Summary(
        file=str(file.path),
        title=file.title,
        state=status.state,
        reason=status.reason,
        no_result=no_result(file),
        generations=len(generations),
        strings=len(results),
        samples_used=int(results["samples_used"].sum()),
        samples_simulated=len(samples) - fresh,
        samples_fresh=fresh,
        samples_in_larger_volumes=file.volume_count,
        failed=int((file.counted_samples["state"] == FAILED).sum()),
        hit_maximum=int(results["hit_maximum"].sum()),
        not_converged=unconverged(file),
        damaged=file.damaged,
        seconds=seconds,
        samples_per_second=(len(samples) + file.volume_count) / seconds if seconds else 0.0,
        derived={column.name: column.unit for column in derived_columns(file)},
        best=collect_best(file, best),
        verdict=file.derived(_verdict),
        further={variable.name: variable.unit for variable in file.variables.further},
    )


def summary_table(file: CampaignData, best: int | None = None) -> RenderableType:
    """Return a table of the best strings, and the cost of the campaign.

    There are `best` strings at most, or `listed_strings`.
    """
    summary = collect_summary(file, listed_strings(file) if best is None else best)
    parts: list[RenderableType] = [summary.title] if summary.title else []
    if not summary.no_result:
        parts.append(best_table(file, summary.best))
    parts += [*state_lines(file), _cost(summary)]
    if not summary.no_result:
        parts += describe_best(file, [entry["string"] for entry in summary.best])
        parts += failure_lines(file)
    if ranks_itself(file) and summary.best:
        parts.append(SEARCH_ESTIMATES)
    if summary.not_converged:
        strings = pluralise(summary.not_converged, "string")
        parts.append(f"{strings} ended at max_samples, not converged")
    return Group(*parts, summary.file)


def describe_best(file: CampaignData, shown: Sequence[int]) -> list[str]:
    """Return lines on the order of the best strings, their fit to data and their finite size."""
    known = rank_strings(file).estimates
    estimated = {estimate.string for estimate in known}.intersection(shown)
    lines = describe_bias(file.derived(_verdict), shown, len(estimated))
    fit = describe_fit(file, shown[0]) if shown else []
    return [*lines, *objective_of(file).notes, *fit, *describe_finite_size(file, shown)]


def _verdict(file: CampaignData) -> SelectionBias | None:
    known = rank_strings(file).estimates
    return selection_bias(known, PairedSamples.behind(known, file), rounding_of(file))


SEARCH_ESTIMATES: Final = (
    "objectives as searched are of each string's own samples; the progress of a run shows the "
    "search's estimates, which rest on more"
)
"""Note on a search that ranks strings by more than their own samples."""


def _cost(summary: Summary) -> str:
    """Return a line on the number of samples and the time of a campaign."""
    fresh = ""
    if summary.samples_fresh:
        fresh = f" and {pluralise(summary.samples_fresh, 'fresh one')}"
    if summary.samples_in_larger_volumes:
        fresh += f", {summary.samples_in_larger_volumes} in larger volumes"
    return (
        f"{pluralise(summary.generations, 'generation')}, {pluralise(summary.strings, 'string')}, "
        f"{pluralise(summary.samples_used, 'sample')} used of {summary.samples_simulated} "
        f"simulated{fresh}, "
        f"{format_duration(summary.seconds)}, {summary.samples_per_second:.0f} samples/s"
    )


def as_dict(summary: Summary, more: Mapping[str, Any] | None = None) -> dict[str, Any]:
    """Return a summary, and `more` entries, for JSON; nan and inf become None."""
    verdict = summary.verdict
    said = verdict and {**verdict._asdict(), "is_bias": verdict.is_bias}
    entries = summary._asdict() | {"verdict": said} | dict(more or {})
    if not summary.further:
        del entries["further"]
    if not summary.samples_in_larger_volumes:
        del entries["samples_in_larger_volumes"]
    return dict(without_nan(entries))


def to_json(summary: Summary, more: Mapping[str, Any] | None = None) -> str:
    """Return `as_dict` as JSON."""
    return json.dumps(as_dict(summary, more), indent=2)
