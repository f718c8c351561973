"""Sections on the run: search, particles, samples, starts, worst samples, failures, origin."""

from collections.abc import Iterator
from datetime import UTC, datetime
from typing import Any, Final

import numpy as np

from agglom_mpi.analysis.failed_samples import reason_counts
from agglom_mpi.analysis.ranking import rank_strings
from agglom_mpi.config.yaml_source import CampaignError
from agglom_mpi.display.table import Column, Table
from agglom_mpi.formatting import format_duration, pluralise
from agglom_mpi.outcome import COLUMNS, COMPLETED, FAILED, LEDGER
from agglom_mpi.report.sections.section import (
    Block,
    Page,
    bullets,
    folded,
    note,
    section,
    warning,
)
from agglom_mpi.storage.attributes import earlier_data
from agglom_mpi.storage.reader import CampaignData
from agglom_mpi.storage.schema import FAILURE_CAPACITY

LAST: Final = 20
"""Maximum number of starts of the program, and of texts of failures, that are listed."""
MOST_FAILING: Final = 6
"""Maximum number of strings that are named for their failures."""
PROVENANCE: Final = ("seed", "created", "code_version", "campaign_sha256", "sources_sha256")
"""Attributes of the file that the page names."""


@section(6, "Search")
def search(page: Page) -> Iterator[Block | Table]:
    """Yield the figures of the search."""
    figures = page.figures("search")
    yield figures
    if not figures.content:
        yield note("No generation is done yet.")
    if page.options.sensitivity and "sensitivity" not in [each["name"] for each in figures.content]:
        yield note(
            "Sensitivity: too few strings, all worth the same, or a regression that predicts "
            "nothing."
        )


@section(7, "Particles")
def particles(page: Page) -> Iterator[Block | Table]:
    """Yield the figures of particles."""
    yield page.figures("particles")
    if not rank_strings(page.data).order:
        yield note("No string has a result yet.")
    elif page.why_no_frames:
        yield note(
            f"No cloud of particles: {page.why_no_frames}. The campaign's output.frames stores "
            "some."
        )


@section(8, "Samples")
def samples(page: Page) -> Iterator[Block | Table]:
    """Yield the figures of ensembles."""
    figures = page.figures("samples")
    yield figures if figures.content else note("No string is judged yet.")


@section(11, "Run")
def run(page: Page) -> Iterator[Block | Table]:
    """Yield how busy the ranks were, and the starts of the program."""
    yield page.figures("run")
    if not len(page.data.legs()):
        yield note("The campaign has not been started yet.")
        return
    yield legs(page.data)
    ranks = int(page.data.legs()["ranks"].max())
    employed = len(np.unique(page.data.all_sample_rows()["rank"]))
    if 0 < employed < ranks:
        yield note(
            f"{employed} of {ranks} ranks simulated: there was no more work, or rank 0 had no time "
            "for more ranks."
        )


LEG_COLUMNS: Final = (
    Column("leg", format="d"),
    Column("started", "started (UTC)", text=True),
    Column("lasted"),
    Column("ranks", format="d"),
    Column("nodes", "machines", format="d"),
    Column("samples", format="d"),
    Column("busy", format=".1%"),
    Column("on a core", format=".1%"),
    Column("writing", format=".2%"),
    Column("database", "written by", text=True),
    Column("exit_code", "exit code", format="d"),
    Column("on", text=True),
    Column("version", "agglom_mpi", text=True),
)


def legs(data: CampaignData) -> Table:
    """Return the last starts of the program, one a row."""
    rows = data.legs()[-LAST:]
    first = len(data.legs()) - len(rows)
    lines = [_leg(row) | {"leg": first + i} for i, row in enumerate(rows, 1)]
    return Table(LEG_COLUMNS, lines, "Starts of the program", "starts")


def _leg(row: np.void) -> dict[str, Any]:
    lasted = float(row["stopped"] - row["started"])
    ended = np.isfinite(lasted)
    found: dict[str, Any] = {name: row[name] for name in ("ranks", "nodes")}
    found["started"] = _date(float(row["started"]))
    found["lasted"] = format_duration(lasted) if ended else "no end"
    found["database"] = _text(row["database"])
    found["on"] = f"{_text(row['host'])}, {_text(row['processor'])}"
    version = f"{_text(row['code_version'])} {_text(row['git_revision'])[:10]}"
    found["version"] = version.strip()
    if ended:
        available = lasted * row["ranks"]
        found |= {name: row[name] for name in ("samples", "exit_code")}
        found["busy"] = _share(row["busy_seconds"], available)
        found["on a core"] = _share(row["cpu_seconds"], row["busy_seconds"])
        found["writing"] = _share(row["database_seconds"], available)
    return found


def _share(part: float, whole: float) -> float | None:
    return part / whole if whole > 0.0 and np.isfinite(part) else None


def _date(seconds: float) -> str:
    try:
        return datetime.fromtimestamp(seconds, UTC).strftime("%Y-%m-%d %H:%M:%S")
    except (OSError, OverflowError, ValueError):
        return "no date"


def _text(value: bytes) -> str:
    return value.decode(errors="replace")


@section(12, "What the scene left out")
def scene(page: Page) -> Iterator[Block | Table]:
    """Yield the submodels, and what is left out."""
    try:
        headings = dict(page.described)
    except CampaignError as error:
        yield warning(f"The campaign's text in the file cannot be read: {error}")
        return
    yield bullets(headings.pop("Left out"), "Left out")
    yield bullets(headings.pop("Submodels"), "Submodels in use")
    lines = [
        line for heading, own in headings.items() for line in (heading, *(f"  {x}" for x in own))
    ]
    yield folded("The campaign as text", "\n".join(lines))


@section(13, "Worst samples of the ledger")
def ledger(page: Page) -> Iterator[Block | Table]:
    """Yield the worst sample of each column of the ledger."""
    completed = int((page.data.counted_samples["state"] == COMPLETED).sum())
    if not completed:
        yield note("No sample is completed yet.")
        return
    yield ledger_table(page.data)
    yield note(
        f"Over {pluralise(completed, 'completed sample')}. Nothing is clipped in silence: what a "
        "submodel capped or refused is counted here."
    )


LEDGER_COLUMNS: Final = (
    Column("entry"),
    Column("worst"),
    Column("affected", "samples with any", format="d"),
    Column("string", format="d"),
    Column("sample", format="d"),
    Column("replay", "to simulate it again", text=True),
)


def ledger_table(data: CampaignData) -> Table:
    """Return the worst completed sample of each column of the ledger, and how to simulate it."""
    rows = data.counted_samples[data.counted_samples["state"] == COMPLETED]
    meanings = {column.name: column.meaning for column in COLUMNS}
    lines: list[dict[str, Any]] = []
    for name in LEDGER:
        size = np.abs(np.nan_to_num(rows[name].astype(float)))
        worst = rows[int(np.argmax(size))]
        is_count = rows[name].dtype.kind == "i"
        line: dict[str, Any] = {"entry": meanings[name]}
        line["worst"] = str(worst[name]) if is_count else f"{worst[name]:.3g}"
        if is_count:
            line["affected"] = np.count_nonzero(size)
        if size.max() > 0.0:
            place = f"--string {worst['string']} --sample {worst['sample']}"
            line |= {name: worst[name] for name in ("string", "sample")}
            line["replay"] = f"agglom simulate {data.path.name} {place}"
        lines.append(line)
    return Table(LEDGER_COLUMNS, lines, name="worst_samples")


@section(14, "Failures")
def failures(page: Page) -> Iterator[Block | Table]:
    """Yield why samples failed, where, and the texts of the last failures."""
    data = page.data
    rows = data.all_sample_rows()
    failed, simulated = rows[rows["state"] == FAILED], pluralise(len(rows), "sample")
    late = len(data.timed_out)
    if not len(failed) and not late:
        yield note(f"None of {simulated} failed.")
        return
    reasons = reason_counts(np.sort(failed["reason"]))
    lines = [f"{count} of {simulated}: {reason}" for reason, count in reasons.items()]
    if late:
        lines.append(f"{pluralise(late, 'sample')} without a row: took longer than max_seconds")
    yield bullets(lines)
    if len(failed):
        strings, numbers = np.unique(failed["string"], return_counts=True)
        most = np.argsort(-numbers, kind="stable")[:MOST_FAILING]
        named = ", ".join(f"string {strings[i]} ({numbers[i]})" for i in most)
        yield note(f"Most failures: {named}.")
    if texts := [_failure(row) for row in data.failures()[-LAST:]]:
        count = len(data.failures())
        full = ", for more there is no room" if count == FAILURE_CAPACITY else ""
        yield folded(f"Last {len(texts)} of {count} texts{full}", "\n\n".join(texts))


def _failure(row: np.void) -> str:
    place = f"string {row['string']} sample {row['sample']}, rank {row['rank']}"
    return f"{place} on {_text(row['host'])}:\n{_text(row['text'])}"


@section(15, "Where this is from")
def origin(page: Page) -> Iterator[Block | Table]:
    """Yield the provenance of the file, and its campaign."""
    found = page.data.attributes
    lines = [f"{name.replace('_', ' ')}: {found[name]}" for name in PROVENANCE if name in found]
    for each in earlier_data(found):
        data = ", ".join(f"{key} {value}" for key, value in each["data"].items())
        strings, legs = pluralise(each["strings"], "string"), pluralise(each["legs"], "start")
        lines.append(f"{strings} of the first {legs} chosen by earlier data: {data}")
    yield bullets(lines)
    yield folded("The campaign file", page.data.campaign_text)
