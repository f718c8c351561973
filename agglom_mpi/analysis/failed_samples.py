"""Why samples failed, and what is reported of a campaign in which no string has a result."""

from collections import Counter
from shlex import quote
from typing import TYPE_CHECKING, Final

import numpy as np

from agglom_mpi.analysis.estimates import objective_of
from agglom_mpi.formatting import pluralise, shortened
from agglom_mpi.outcome import FAILED, REASONS, FailureReason
from agglom_mpi.storage.lock import live_status
from agglom_mpi.storage.schema import TOOK_TOO_LONG

if TYPE_CHECKING:
    from agglom_mpi.storage.reader import CampaignData

NO_RESULT: Final = "no string has a result"
"""Beginning of the line that reports it."""
PLACE: Final = '  File "'
"""Beginning of the lines of a traceback that name a file and a line."""
LONGEST_MESSAGE: Final = 200
"""Maximum number of characters that are reported of an exception's message."""


def cause_of(text: str) -> str:
    """Return what failures of the same cause share: the last place and the type of an exception.

    Its message may differ from sample to sample. A timeout, and a text without any place, is its
    own cause.

    Parameters
    ----------
    text
        Of a row of `/failures`: a traceback, cut at its beginning, or a timeout.
    """
    places = [line.strip() for line in text.splitlines() if line.startswith(PLACE)]
    message = message_of(text)
    if text.startswith(TOOK_TOO_LONG) or not places:
        return message
    return f"{places[-1]}: {message.partition(':')[0]}"


def message_of(text: str) -> str:
    """Return the line of a failure's text that names the exception, and begins its message."""
    lines = [line for line in text.splitlines() if line.strip()] or [""]
    place = max((i for i, line in enumerate(lines) if line.startswith(PLACE)), default=len(lines))
    after = [line for line in lines[place + 1 :] if not line.startswith(" ")]
    return shortened((after or lines[-1:])[0].strip(), LONGEST_MESSAGE)


def no_result(data: "CampaignData") -> str:
    """Return a line on a campaign that has judged strings, none with a finite objective.

    It names the commonest reason for failed samples and the number of its samples. The line is
    empty where a string has a result, and where none is judged yet.
    """
    results = data.result_rows()
    if not len(results) or np.isfinite(results["objective"]).any():
        return ""
    samples, failed = int(results["samples_used"].sum()), int(results["failed"].sum())
    if not failed:
        why = objective_of(data).why_infinite
        return f"{NO_RESULT}: {pluralise(samples, 'sample')} completed, but {why}"
    limit = "" if failed == samples else ", at most 10 % of those of a string may"
    reason, count = commonest_reason(data)
    return (
        f"{NO_RESULT}: {failed} of {pluralise(samples, 'sample')} failed{limit}; commonest reason "
        f"({pluralise(count, 'sample')}): {reason}"
    )


def commonest_reason(data: "CampaignData") -> tuple[str, int]:
    """Return the commonest reason for which judged samples failed, and the number of these.

    Exceptions count together where they have the same cause; the text is that of the first.
    """
    rows = data.searched_samples
    rows = rows[rows["state"] == FAILED]
    rows = rows[data.are_used(rows)]
    raised = rows["reason"] == FailureReason.EXCEPTION
    counts = reason_counts(np.sort(rows["reason"][~raised]))
    judged = {*rows[["string", "sample"]][raised].tolist(), *data.judged_timed_out}
    messages: dict[str, str] = {}
    for row in data.failures():
        if (int(row["string"]), int(row["sample"])) in judged:
            judged.discard((int(row["string"]), int(row["sample"])))
            text = row["text"].decode(errors="replace")
            message = messages.setdefault(cause_of(text), message_of(text))
            counts[message] += 1
    if judged:  # of a table that was full
        counts[REASONS[FailureReason.EXCEPTION]] += len(judged)
    [(reason, count)] = counts.most_common(1) or [("unknown", 0)]
    return reason, count


def reason_counts(codes: np.ndarray) -> Counter[str]:
    """Return the numbers of failed samples by reason, in the order of the codes, (n,)."""
    return Counter(
        REASONS[code] if code < len(REASONS) else f"unknown ({code})" for code in codes.tolist()
    )


def failure_lines(data: "CampaignData") -> list[str]:
    """Return lines on the failed samples of a campaign: why, what follows, how to repeat one."""
    rows = data.counted_samples
    rows = rows[rows["state"] == FAILED]
    if not len(rows):
        return []
    reasons = reason_counts(rows["reason"]).most_common()
    counts = ", ".join(f"{count} by {reason}" for reason, count in reasons)
    string, sample = rows[0]["string"], rows[0]["sample"]
    return [
        f"{pluralise(len(rows), 'sample')} failed ({counts}); "
        "a string with more than 10 % failed samples has the objective inf",
        f"agglom simulate {quote(str(data.path))} --string {string} --sample {sample}: "
        "repeats the first of them",
    ]


def state_lines(data: "CampaignData") -> list[str]:
    """Return lines on the state of a campaign: that no string has a result, and why it ended."""
    state, _, reason = live_status(data)
    missing = no_result(data)
    if reason.startswith(NO_RESULT):  # cut to fit into the file
        return [f"{state}: {missing or reason}"]
    return [*([missing] if missing else []), f"{state}: {reason}" if reason else state]
