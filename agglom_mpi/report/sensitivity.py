"""Which variables matter, from the strings that a campaign file holds already."""

from typing import TYPE_CHECKING, Any

import numpy as np
from rich.console import Group, RenderableType
from rich.table import Table

from agglom_mpi.campaign import Campaign
from agglom_mpi.database.contents import strings_of
from agglom_mpi.database.reader import CampaignFile
from agglom_mpi.search.space import search_space

if TYPE_CHECKING:
    from agglom_mpi.search.sensitivity import Sensitivity


def of_campaign(file: CampaignFile) -> tuple[tuple[str, ...], "Sensitivity | None"]:
    """Variables that were searched, and how much each matters; None of too few strings.

    Strings that could not be judged are left out.
    """
    from agglom_mpi.search.sensitivity import sensitivity

    variables = Campaign.from_text(file.campaign_text, str(file.path)).variables
    strings, results = file.string_rows(), file.result_rows()
    _, of_string, of_result = np.intersect1d(
        strings["string"], results["string"], return_indices=True
    )
    strings, results = strings[of_string], results[of_result]
    finite = np.isfinite(results["objective"])
    points = search_space(variables).to_unit(strings_of(strings))
    samples = results["samples_used"] - results["failed"]
    found = sensitivity(points[finite], results["objective"][finite], samples[finite])
    return variables.searched, found


def as_dict(names: tuple[str, ...], found: "Sensitivity | None") -> dict[str, Any] | None:
    """Return the same as plain numbers, for JSON."""
    if found is None:
        return None
    indices = zip(names, found.first_order.tolist(), found.total.tolist(), strict=True)
    return {
        "strings": found.strings,
        "explained": found.explained,
        "noise": found.noise,
        "variables": {
            name: {"first_order": first, "total": total} for name, first, total in indices
        },
    }


def in_words(names: tuple[str, ...], found: "Sensitivity | None") -> RenderableType:
    """Table of the variables, those that matter most first, and what it rests on."""
    if found is None:
        return "sensitivity: too few strings, or all of them are worth the same"
    table = Table(box=None, padding=(0, 2, 0, 0))
    table.add_column("share of the variance of the objective", no_wrap=True)
    table.add_column("alone", justify="right")
    table.add_column("with others", justify="right")
    for i in np.argsort(-found.total, kind="stable").tolist():
        table.add_row(names[i], f"{found.first_order[i]:.1%}", f"{found.total[i]:.1%}")
    return Group(
        "",
        table,
        f"over the search box, by a regression of {found.strings} strings; it predicts "
        f"{found.explained:.0%} of the variance of strings left out, noise of samples is "
        f"{found.noise:.0%}",
    )
