"""Output of `agglom report` for a campaign whose code may not run: the stored numbers."""

import json
from typing import TYPE_CHECKING, Any

from agglom_mpi.formatting import in_unit, without_nan
from agglom_mpi.storage.lock import live_status
from agglom_mpi.storage.recorded_campaign import code_note

if TYPE_CHECKING:
    from agglom_mpi.storage.reader import CampaignData


def stored_summary(file: "CampaignData") -> dict[str, Any]:
    """Return the numbers of a file that need none of the campaign's classes, in SI units.

    The best string is that of the last generation, as searched.
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
        for variable, row in zip(file.variables.variables, file.variable_rows(), strict=True):
            if row["searched"] == 1:
                found[variable.name] = float(file.values([string], variable.name)[0])
    return dict(without_nan(found))


def stored_text(file: "CampaignData", as_json: bool) -> str:
    """Return these numbers as lines or as JSON, and why there are no others."""
    found = stored_summary(file)
    if as_json:
        return json.dumps(
            {"file": str(file.path), **found, "needs_code": code_note(file)}, indent=2
        )
    units = {variable.name: variable.unit for variable in file.variables.variables}
    lines = [f"{name}: {in_unit(value, units.get(name, '1'))}" for name, value in found.items()]
    return "\n".join([*lines, code_note(file)])
