"""Summary of a campaign: the numbers of `agglom report`, and its table."""

import json
from collections.abc import Mapping, Sequence
from typing import Any, Final

import numpy as np
from rich.console import Group, RenderableType

from agglom_mpi.analysis.best_strings import best_table, collect_best
from agglom_mpi.analysis.data_fit import describe_fit
from agglom_mpi.analysis.derived import derived_columns, recorded_box
from agglom_mpi.analysis.estimates import (
    is_free_of_noise,
    kept,
    not_converged,
    objective_of,
    rounding_of,
    unconverged,
)
from agglom_mpi.analysis.failed_samples import failure_lines, no_result, state_lines
from agglom_mpi.analysis.finite_size import describe_finite_size
from agglom_mpi.analysis.ranking import listed_strings, rank_strings, ranks_itself
from agglom_mpi.analysis.selection_bias import (
    PairedSamples,
    SelectionBias,
    describe_bias,
    selection_bias,
)
from agglom_mpi.formatting import format_duration, in_unit, pluralise, without_nan
from agglom_mpi.outcome import FAILED
from agglom_mpi.storage.lock import live_status
from agglom_mpi.storage.reader import CampaignData
from agglom_mpi.storage.recorded_campaign import code_note


def collect_summary(file: CampaignData, best: int = 6) -> dict[str, Any]:
    """Return the numbers of `agglom report` of a campaign file, finished or not, by JSON key.

    `no_result` says why no string has a result. `not_converged` counts the strings of `hit_maximum`
    whose samples differ by more than rounding. `derived` and `further` are the SI units of derived
    columns and of variables beside those of the papers.

    Parameters
    ----------
    file
        The campaign.
    best
        Number of the best strings to include. Each has a `reestimate` on its fresh samples, None if
        it has none.
    """
    results, legs, status = file.result_rows(), file.legs(), live_status(file)
    samples, generations = file.all_sample_rows(), file.generation_rows()
    fresh = int((samples["sample"] >= file.fresh_from).sum())
    whole = legs[np.isfinite(legs["stopped"])]
    seconds = float((whole["stopped"] - whole["started"]).sum())
    if len(whole) < len(legs) and len(generations):
        seconds = max(seconds, float(generations["seconds"].max()))
    larger, verdict = file.volume_count, _verdict(file)
    further = {variable.name: variable.unit for variable in file.variables.further}
    return {
        "file": str(file.path),
        "title": file.title,
        "state": status.state,
        "reason": status.reason,
        "no_result": no_result(file),
        "generations": len(generations),
        "strings": len(results),
        "samples_used": int(results["samples_used"].sum()),
        "samples_simulated": len(samples) - fresh,
        "samples_fresh": fresh,
        **({"samples_in_larger_volumes": larger} if larger else {}),
        "failed": int((file.counted_samples["state"] == FAILED).sum()),
        "hit_maximum": int(results["hit_maximum"].sum()),
        "not_converged": unconverged(file),
        "damaged": file.damaged,
        "seconds": seconds,
        "samples_per_second": (len(samples) + larger) / seconds if seconds else 0.0,
        "derived": {column.name: column.unit for column in derived_columns(file)},
        "best": collect_best(file, best),
        "verdict": verdict and {**verdict._asdict(), "is_bias": verdict.is_bias},
        **({"further": further} if further else {}),
    }


def summary_table(file: CampaignData, best: int | None = None) -> RenderableType:
    """Return a table of the best strings, and the cost of the campaign.

    There are `best` strings at most, or `listed_strings`.
    """
    summary = collect_summary(file, listed_strings(file) if best is None else best)
    parts: list[RenderableType] = [summary["title"]] if summary["title"] else []
    if not summary["no_result"]:
        parts.append(best_table(file, summary["best"]))
    parts += [*state_lines(file), _cost(summary)]
    if not summary["no_result"]:
        parts += describe_best(file, [entry["string"] for entry in summary["best"]])
        parts += failure_lines(file)
    return Group(*parts, *not_converged(file), summary["file"])


def describe_best(file: CampaignData, shown: Sequence[int]) -> list[str]:
    """Return lines on the order of the best strings, their fit to data and their finite size."""
    known = rank_strings(file).estimates
    estimated = {estimate.string for estimate in known}.intersection(shown)
    noisy = not is_free_of_noise(file)
    lines = describe_bias(_verdict(file), shown, len(estimated)) if noisy else ()
    fit = describe_fit(file, shown[0]) if shown else []
    found = [*lines, *objective_of(file).notes, *fit, *describe_finite_size(file, shown)]
    return [*found, SEARCH_ESTIMATES] if ranks_itself(file) and shown else found


@kept
def _verdict(file: CampaignData) -> SelectionBias | None:
    known = rank_strings(file).estimates
    return selection_bias(known, PairedSamples.behind(known, file), rounding_of(file))


SEARCH_ESTIMATES: Final = (
    "objectives as searched are of each string's own samples; the progress of a run shows the "
    "search's estimates, which rest on more"
)
"""Note on a search that ranks strings by more than their own samples."""


def _cost(summary: Mapping[str, Any]) -> str:
    """Return a line on the number of samples and the time of a campaign."""
    fresh = ""
    if summary["samples_fresh"]:
        fresh = f" and {pluralise(summary['samples_fresh'], 'fresh one')}"
    if larger := summary.get("samples_in_larger_volumes"):
        fresh += f", {larger} in larger volumes"
    counts = (("generations", "generation"), ("strings", "string"), ("samples_used", "sample"))
    made = ", ".join(pluralise(summary[key], noun) for key, noun in counts)
    return (
        f"{made} used of {summary['samples_simulated']} simulated{fresh}, "
        f"{format_duration(summary['seconds'])}, {summary['samples_per_second']:.0f} samples/s"
    )


def to_json(summary: Mapping[str, Any], more: Mapping[str, Any] | None = None) -> str:
    """Return a summary, and `more` entries, as JSON; nan and inf become null."""
    return json.dumps(without_nan({**summary, **(more or {})}), indent=2)


def stored_text(file: CampaignData, as_json: bool) -> str:
    """Return the stored numbers of a campaign whose code may not run, and why there are no others.

    They are lines or JSON, in SI units. The best string is that of the last generation, as
    searched.
    """
    status, generations, results = live_status(file), file.generation_rows(), file.result_rows()
    found = {
        "title": file.title,
        "state": status.state,
        "reason": status.reason,
        "generations": len(generations),
        "strings": len(results),
        "samples_used": int(results["samples_used"].sum()),
        "samples_stored": len(file.all_sample_rows()),
        "damaged": file.damaged,
    }
    for last in generations[-1:]:
        found["best_string"] = string = int(last["best_string"])
        found["objective"] = float(last["best_objective"])
        found["standard_error"] = float(last["best_standard_error"])
        for variable in recorded_box(file).variables:
            if variable.is_searched:
                found[variable.name] = float(file.values([string], variable.name)[0])
    found = without_nan(found)
    if as_json:
        note = {"needs_code": code_note(file)}
        return json.dumps({"file": str(file.path), **found, **note}, indent=2)
    units = {variable.name: variable.unit for variable in file.variables.variables}
    lines = [f"{name}: {in_unit(value, units.get(name, '1'))}" for name, value in found.items()]
    return "\n".join([*lines, code_note(file)])
