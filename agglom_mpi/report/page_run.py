"""Parts of the page on how a campaign ran, what it left out, and what went wrong."""

from collections.abc import Iterator
from datetime import UTC, datetime
from typing import Final

import numpy as np

from agglom_mpi.analysis.resimulation import recorded_campaign
from agglom_mpi.config.describe import sections
from agglom_mpi.config.yaml_source import CampaignError
from agglom_mpi.formatting import format_duration, pluralise
from agglom_mpi.outcome import COLUMNS, COMPLETED, FAILED, LEDGER, REASONS
from agglom_mpi.report.html import folded, listed, paragraph, table
from agglom_mpi.storage.reader import CampaignData
from agglom_mpi.storage.schema import FAILURE_CAPACITY

SHOWN: Final = 20
"""Legs and exceptions that are listed, the last ones."""


def legs(data: CampaignData) -> str:
    """Return the table of the starts of the program."""
    rows = data.legs()[-SHOWN:]
    if not len(rows):
        return paragraph("The campaign has not been started yet.")
    first = len(data.legs()) - len(rows)
    lines = [[str(first + i), *_leg(row)] for i, row in enumerate(rows, 1)]
    headings = (
        "leg",
        "started (UTC)",
        "lasted",
        "ranks",
        "machines",
        "samples",
        "busy",
        "writing",
        "written by",
        "exit code",
        "on",
        "agglom_mpi",
    )
    return table(headings, lines, "Starts of the program", texts=(1, 8, 10, 11))


def _leg(row: np.void) -> Iterator[str]:
    lasted = float(row["stopped"] - row["started"])
    ended = np.isfinite(lasted)
    available = lasted * row["ranks"] if ended and lasted > 0.0 else np.nan
    yield datetime.fromtimestamp(float(row["started"]), UTC).strftime("%Y-%m-%d %H:%M:%S")
    yield format_duration(lasted) if ended else "no end"
    yield str(row["ranks"])
    yield str(row["nodes"])
    yield str(row["samples"]) if ended else ""
    yield f"{row['busy_seconds'] / available:.1%}" if ended else ""
    yield f"{row['database_seconds'] / available:.2%}" if ended else ""
    yield _text(row["database"])
    yield str(row["exit_code"]) if ended else ""
    yield f"{_text(row['host'])}, {_text(row['processor'])}"
    yield f"{_text(row['code_version'])} {_text(row['git_revision'])[:10]}".strip()


def _text(value: bytes) -> str:
    return value.decode(errors="replace")


def left_out(data: CampaignData) -> str:
    """Return what the scene has and what it leaves out, and the rest of the campaign folded up."""
    try:
        found = sections(recorded_campaign(data))
    except CampaignError as error:
        return paragraph(f"The campaign's text in the file cannot be read: {error}", "warning")
    named = dict(found[1:])
    text = "<h3>Left out</h3>" + listed(named.pop("Left out"))
    text += "<h3>Submodels in use</h3>" + listed(named.pop("Submodels"))
    rest = [found[0], *named.items()]
    lines = [line for heading, own in rest for line in (heading, *(f"  {x}" for x in own))]
    return text + folded("The campaign in words", "\n".join(lines))


def ledger(data: CampaignData) -> str:
    """Return the worst sample of each column of the ledger, and how to look at it again."""
    rows = data.all_sample_rows()[data.all_sample_rows()["state"] == COMPLETED]
    if not len(rows):
        return paragraph("No sample is completed yet.")
    meanings = {column.name: column.meaning for column in COLUMNS}
    lines = []
    for name in LEDGER:
        size = np.abs(np.nan_to_num(rows[name].astype(float)))
        worst = rows[int(np.argmax(size))]
        whole = rows[name].dtype.kind == "i"
        what = f"{int(np.count_nonzero(size))}" if whole else ""
        where = ["", "", ""]
        if size.max() > 0.0:
            where = [str(worst["string"]), str(worst["sample"]), _replay(data, worst)]
        shown = str(worst[name]) if whole else f"{worst[name]:.3g}"
        lines.append([meanings[name], shown, what, *where])
    headings = ("", "worst", "samples with any", "string", "sample", "to simulate it again")
    return table(headings, lines, texts=(5,)) + paragraph(
        f"Over {len(rows)} completed samples. Nothing is clipped in silence: what a submodel "
        "capped or refused is counted here."
    )


def _replay(data: CampaignData, row: np.void) -> str:
    name = data.path.name
    return f"agglom simulate {name} --string {row['string']} --sample {row['sample']}"


def failures(data: CampaignData) -> str:
    """Return the samples that failed, why, and rows that are damaged."""
    samples = data.all_sample_rows()
    failed = samples[samples["state"] == FAILED]
    late = data.timed_out
    damaged = data.damaged
    text = ""
    if damaged:
        said = f"{pluralise(damaged, 'row')} marked final with a wrong checksum, left out here; "
        text += paragraph(f"{said}agglom check {data.path.name} names them.", "warning")
    if not len(failed) and not late:
        return text + paragraph(f"None of {len(samples)} samples failed.")
    reasons = np.bincount(failed["reason"], minlength=len(REASONS)).tolist()
    lines = [f"{n} of {len(samples)} samples: {_reason(i)}" for i, n in enumerate(reasons) if n]
    if late:
        lines.append(
            f"{pluralise(len(late), 'sample')} without a row: took longer than max_seconds"
        )
    text += listed(lines) + _failing_strings(failed)
    if len(data.failures()):
        full = ", for more there is no room" * (len(data.failures()) == FAILURE_CAPACITY)
        text += folded(
            f"Last {min(SHOWN, len(data.failures()))} of {len(data.failures())} texts{full}",
            "\n\n".join(_failure(row) for row in data.failures()[-SHOWN:]),
        )
    return text


def _reason(code: int) -> str:
    return REASONS[code] if 0 < code < len(REASONS) else f"unknown reason ({code})"


def _failing_strings(failed: np.ndarray) -> str:
    strings, counts = np.unique(failed["string"], return_counts=True)
    worst = np.argsort(-counts, kind="stable")[:6]
    named = ", ".join(f"string {strings[i]} ({counts[i]})" for i in worst)
    return paragraph(f"Most failures: {named}.") if len(strings) else ""


def _failure(row: np.void) -> str:
    place = f"string {row['string']} sample {row['sample']}, rank {row['rank']}"
    return f"{place} on {_text(row['host'])}:\n{_text(row['text'])}"


def provenance(data: CampaignData) -> str:
    """Return where the numbers are from: seed, digests, and the text of the campaign."""
    about = data.attributes
    lines = [
        f"{name.replace('_', ' ')}: {about[name]}"
        for name in ("seed", "created", "code_version", "campaign_sha256", "sources_sha256")
        if name in about
    ]
    return listed(lines) + folded("The campaign file", data.campaign_text)
