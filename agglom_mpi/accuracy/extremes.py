"""Stiff and extreme scenes, with this package's method and with the published one."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any, Final

from agglom_mpi.accuracy.document import ReportSection, ReportTable, Sentences, TableColumn
from agglom_mpi.accuracy.published_method import as_published
from agglom_mpi.accuracy.run_times import time_text
from agglom_mpi.accuracy.soundness import CLOSED, heaped_overlaps, summary, troubles
from agglom_mpi.accuracy.study import Rows, Setup, with_scene
from agglom_mpi.accuracy.time_integration import event_engine
from agglom_mpi.config.campaign import Campaign
from agglom_mpi.config.loading import load_campaign
from agglom_mpi.formatting import format_mean
from agglom_mpi.statistics import MeanEstimate

METHODS: Final = ("ours", "published")


def read_scenes(directory: Path, allow_code: bool = False) -> dict[str, Campaign]:
    """Return the scenes of a directory by file stem; raise a CampaignError if one is wrong."""
    return {path.stem: load_campaign(path, allow_code) for path in sorted(directory.glob("*.yaml"))}


def published_name(scene: str) -> str:
    """Return the name of the set-up that runs a scene as published."""
    return f"{scene}, as published"


def setups(scenes: Mapping[str, Campaign], samples: int) -> dict[str, Setup]:
    """Return two set-ups for every scene: this package's method, and the published one."""
    chosen = {}
    for name, campaign in scenes.items():
        parameters = campaign.parameters()
        published = with_scene(campaign, **dict(as_published(campaign.scene)))
        if campaign.scene.engine.has_time_steps:  # the steps are what is extreme
            published = with_scene(published, engine=campaign.scene.engine)
        chosen[name] = Setup(campaign, parameters, samples, event_engine(campaign))
        chosen[published_name(name)] = Setup(published, parameters, samples)
    return chosen


def extremes_section(scenes: Mapping[str, Campaign], samples: Mapping[str, Rows]) -> ReportSection:
    """Return the section on extreme scenes; `samples` are those of `setups`, by name."""
    import pandas as pd

    rows = []
    for name, campaign in scenes.items():
        row = {"scene": name, "what": campaign.title}
        row |= {f"ours: {key}": value for key, value in summary(samples[name]).items()}
        published = summary(samples[published_name(name)])
        row |= {f"published: {key}": value for key, value in published.items()}
        rows.append(row)
    frame = pd.DataFrame(rows)
    sentences = Sentences("extremes", closed=CLOSED, scenes=len(frame), **_findings(frame))
    return sentences.section(
        title="Stiff and extreme scenes",
        tables=(ReportTable("extremes", "One row is one scene.", frame, COLUMNS),),
    )


def _own(row: Any, method: str) -> dict[str, Any]:
    """Return the summary of a method from a row of the table."""
    prefix = f"{method}: "
    return {name.removeprefix(prefix): row[name] for name in row.index if name.startswith(prefix)}


def _troubles(row: Any, method: str) -> list[str]:
    """Return descriptions of what went wrong with a scene in one of `METHODS`."""
    return list(troubles(_own(row, method), heaped_overlaps(_own(row, "ours"))).values())


def _growth(row: Any, method: str) -> str:
    good = row[f"{method}: samples"] - row[f"{method}: failed"]
    return format_mean(
        MeanEstimate(row[f"{method}: mean b/b0"], row[f"{method}: standard error"], good)
    )


COLUMNS: Final = (
    TableColumn("scene", lambda row: f"`{row['scene']}`: {row['what']}"),
    TableColumn("ours: b/b⁰", lambda row: _growth(row, "ours")),
    TableColumn("ours", lambda row: "; ".join(_troubles(row, "ours")) or "sound"),
    TableColumn.number("ours: energy error", ".1g", "energy error"),
    TableColumn.number("ours: collisions per sample", ".3g", "collisions"),
    TableColumn("processor time", lambda row: time_text(_own(row, "ours"), "sample")),
    TableColumn("published: b/b⁰", lambda row: _growth(row, "published")),
    TableColumn("published", lambda row: "; ".join(_troubles(row, "published")) or "sound"),
)


def _findings(frame: Any) -> dict[str, Any]:
    """Return what the failures and the conclusions refer to."""
    troubles = [
        {"scene": row["scene"], "method": method, "troubles": "; ".join(_troubles(row, method))}
        for _, row in frame.iterrows()
        for method in METHODS
    ]
    troubled = [one for one in troubles if one["troubles"]]
    published = [one["troubles"] for one in troubled if one["method"] == "published"]
    return {
        "troubled": troubled,
        "sound": {
            method: len(frame) - sum(one["method"] == method for one in troubled)
            for method in METHODS
        },
        "unsolved": sum("impacts unsolved" in text for text in published),
        "below_zero": sum("below zero" in text for text in published),
        "overlaps": sum("overlaps" in text for text in published),
        "energy_error": frame["ours: energy error"].max(),
    }
