"""Decisions made again from stored samples, and `agglom check FILE.h5`."""

from collections.abc import Iterable, Iterator
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from agglom_mpi.config.campaign import Campaign
from agglom_mpi.config.inversion import inversion_of
from agglom_mpi.config.libraries import MissingLibraryError, check_libraries
from agglom_mpi.config.search import EarlierCampaign
from agglom_mpi.config.user_function import recorded_function
from agglom_mpi.config.yaml_source import CampaignError
from agglom_mpi.exit_codes import FAILURE, FINISHED
from agglom_mpi.formatting import pluralise
from agglom_mpi.outcome import FAILED
from agglom_mpi.search.decisions import Decision, GenerationSummary, StringEvaluated
from agglom_mpi.search.ensemble import EnsembleResult
from agglom_mpi.search.inversion import Inversion
from agglom_mpi.search.proposals import MODEL, Proposals, restored
from agglom_mpi.storage.access import DamagedCampaign
from agglom_mpi.storage.consistency import check_digests, check_numbers
from agglom_mpi.storage.contents import VerificationReport, parameters_of, row_list
from agglom_mpi.storage.schema import STUDY
from agglom_mpi.storage.table import consecutive_samples
from agglom_mpi.storage.verify import read_contents
from agglom_mpi.variables import NAMES


class Replayed(NamedTuple):
    """How much of what is stored was decided again, and is the same."""

    strings: int
    results: int
    generations: int


class ReplayLog:
    """The decisions of an inversion: its proposals, results and generations."""

    def __init__(self) -> None:
        self.batches: list[tuple[NDArray[np.int64], Proposals]] = []
        self.results: dict[int, EnsembleResult] = {}
        self.summaries: dict[int, GenerationSummary] = {}

    def record(self, decisions: Iterable[Decision]) -> None:
        """Keep results and generations; strings are kept as they were proposed, not as restored."""
        for decision in decisions:
            match decision:
                case StringEvaluated(string, result):
                    self.results[string] = result
                case GenerationSummary():
                    self.summaries[decision.generation] = decision


def replay(contents: VerificationReport) -> Replayed:
    """Decide everything again as a resume does, and compare; nothing is simulated.

    Raises a MissingLibraryError if that is not possible here.

    Faults, and rows that the decisions need but are absent, are added to the contents.
    """
    try:
        text, code = str(contents.attributes["campaign"]), recorded_function(contents.identity)
        campaign = Campaign.from_text(text, str(contents.path), code)
        _check_campaign(campaign, contents)
        campaign = campaign.with_generations(_generations(contents))
        check_libraries(campaign)
        recorder, inversion = _rerun_decisions(campaign, contents)
    except MissingLibraryError:
        raise
    except (CampaignError, ArithmeticError, LookupError, TypeError, ValueError) as error:
        contents.faults.append(f"replay: not possible: {error}")
        return Replayed(0, 0, 0)
    counts = Replayed(
        _compare_strings(recorder, contents),
        _compare_results(recorder, contents),
        _compare_generations(recorder, contents),
    )
    _check_end(inversion, recorder, contents)
    return counts


def _generations(contents: VerificationReport) -> int:
    """Most generations to decide: all that there is room for, or that strings are stored of.

    In a compact copy there is no room for the generation that the campaign was stopped in.
    """
    proposed = contents.rows["strings"]["generation"].tolist()
    return max([contents.room["generations"], *(number + 1 for number in proposed)])


def _check_campaign(campaign: Campaign, contents: VerificationReport) -> None:
    """Make sure that the text gives what else the file says of the campaign."""
    if campaign.sha256() != contents.attributes["campaign_sha256"] or (
        campaign.identity() != contents.identity
    ):
        contents.faults.append("campaign: the text in the file is not that of its identity")
    if (campaign.seed, campaign.title) != tuple(contents.attributes[n] for n in ("seed", "title")):
        contents.faults.append("attributes: another seed or title than in the campaign's text")
    rows, box = contents.rows["variables"], campaign.variables
    bounds = (rows["lower"], box.lower), (rows["upper"], box.upper)
    if not all(np.array_equal(*pair, equal_nan=True) for pair in bounds):
        contents.faults.append("variables: other bounds than in the campaign's text")


def _rerun_decisions(
    campaign: Campaign, contents: VerificationReport
) -> tuple[ReplayLog, Inversion]:
    known = {
        int(row["string"]): np.array([row[name] for name in NAMES])
        for row in contents.rows["strings"]
    }
    recorder = ReplayLog()

    def restore(batch: Proposals, first: int) -> Proposals:
        recorder.batches.append((np.arange(first, first + len(batch.parameters)), batch))
        return restored(batch, first, known)

    inversion = inversion_of(campaign, _given(campaign, contents), restore)
    recorder.record(inversion.start())
    stored, ahead = contents.searched, contents.room["generations"]
    for samples in stored_outcomes(stored, contents.timed_out):
        # A run may have simulated strings ahead of their generation.
        while inversion.propose_ahead(ahead) is not None:
            pass
        recorder.record(inversion.complete(*samples))
    while inversion.propose_ahead(ahead) is not None:
        pass
    return recorder, inversion


def _given(campaign: Campaign, contents: VerificationReport) -> NDArray[np.float64]:
    """Strings that the search began with, whatever became of an earlier file, shape (n, 10).

    Where a row of them is lost, the middle of the box takes its place, so that all keep theirs.
    """
    start = campaign.search.start
    if not isinstance(start, EarlierCampaign):
        return campaign.given_strings()
    given = np.tile(campaign.parameters(), (start.strings, 1))
    slots = contents.given["slot"]
    given[slots[slots < start.strings]] = parameters_of(contents.given)[slots < start.strings]
    return given


def stored_outcomes(
    samples: NDArray[np.void], late: list[tuple[int, int]]
) -> Iterator[tuple[int, int, NDArray[np.void]]]:
    """Yield samples as `Inversion.complete` takes them: string, first sample, rows.

    Parameters
    ----------
    samples
        Rows of `/samples`, (n,); consecutive samples of a string are yielded together.
    late
        Samples, as (string, sample), that have no row because they took too long.
    """
    for rows in consecutive_samples(samples):
        yield int(rows["string"][0]), int(rows["sample"][0]), rows
    failed = np.zeros(1, samples.dtype)
    failed["state"] = FAILED
    for string, sample in late:
        yield string, sample, failed


def _compare_strings(recorder: ReplayLog, contents: VerificationReport) -> int:
    stored = {int(row["string"]): row for row in contents.rows["strings"]}
    same: set[int] = set()
    other: set[int] = set()  # some strings are proposed ahead, and again
    for ids, batch in recorder.batches:
        believed = contents.ranked_by_model and MODEL in batch.origin
        for i, string in enumerate(ids.tolist()):
            row = stored.get(string)
            if row is None:
                continue
            agrees = (
                row["generation"] == batch.generation
                and row["slot"] == batch.slot[i]
                and row["origin"] == batch.origin[i]
                and np.array_equal(row["parents"], batch.parents[i])
                and (believed or _close([row[name] for name in NAMES], batch.parameters[i]))
            )
            (same if agrees else other).add(string)
    if other:
        contents.faults.append(f"replay: the search proposes other strings than {row_list(other)}")
    return len(same - other)


def _compare_results(recorder: ReplayLog, contents: VerificationReport) -> int:
    stored = {int(row["string"]): row for row in contents.rows["results"]}
    pairs = [(i, result, stored[i]) for i, result in recorder.results.items() if i in stored]
    other = [
        i
        for i, result, row in pairs
        if not all(_close(row[name], value) for name, value in result._asdict().items())
    ]
    if other:
        contents.faults.append(
            f"replay: the samples give other results of strings {row_list(other)}"
        )
    if contents.settled:
        absent = recorder.results.keys() - stored.keys()
        contents.miss("results", absent, "though the samples judge their strings")
    return len(pairs) - len(other)


def _compare_generations(recorder: ReplayLog, contents: VerificationReport) -> int:
    stored = {int(row["generation"]): row for row in contents.rows["generations"]}
    pairs = [(i, done, stored[i]) for i, done in recorder.summaries.items() if i in stored]
    other = [
        i
        for i, done, row in pairs
        if (row["evaluations"], row["samples_used"]) != (done.evaluations, done.samples_used)
        or not (contents.ranked_by_model or _ranks_agree(row, done))
    ]
    if other:
        contents.faults.append(
            f"replay: the search ends otherwise in generations {row_list(other)}"
        )
    if contents.settled:
        absent = recorder.summaries.keys() - contents.recorded
        contents.miss("generations", absent, "though all their strings are judged")
    return len(pairs) - len(other)


def _ranks_agree(row: np.void, done: GenerationSummary) -> bool:
    stored = [row[name] for name in ("best_objective", "best_standard_error", "mean_of_top")]
    return (
        row["best_string"] == done.best
        and np.array_equal(row["population"], done.population)
        and _close(stored, [done.objective, done.standard_error, done.mean_of_top])
    )


def _check_end(inversion: Inversion, recorder: ReplayLog, contents: VerificationReport) -> None:
    """Where the replay ends there must be nothing stored beyond, unless something is lost."""
    if any(contents.lost.values()):
        return
    beyond = set(inversion.open_strings) & contents.numbers("results")
    if contents.settled:  # a proposal need not wait until the samples behind it are written
        proposed = {int(i) for ids, _ in recorder.batches for i in ids}
        beyond |= contents.numbers("strings") - proposed
    if beyond:
        contents.faults.append(f"replay: ends before strings {row_list(beyond)}, which are stored")
    if (
        contents.settled
        and contents.status.state == "finished"
        and not contents.recorded  # with fewer generations asked for, later ones may have begun
    ):
        contents.faults.append("status: finished, but the search is not")


def _close(stored: object, decided: object) -> bool:
    """Whether numbers agree; in the last digits they need not on another kind of processor."""
    left, right = np.asarray(stored, float), np.asarray(decided, float)
    return bool(np.allclose(left, right, rtol=1e-9, atol=1e-12, equal_nan=True))


AGAIN: Final = {
    "strings": "propose again strings",
    "samples": "simulate again",
    "results": "judge again strings",
    "generations": "decide again generations",
    "frames": "take again frames in rows",
}
"""What a resume does with lost rows; those of other tables stay lost."""


def check_file(path: str) -> tuple[str, int]:
    """Verify a campaign file without writing to it: the text to print and the exit code.

    Raises
    ------
    NotACampaign, OSError
        If it is none, or cannot be read.
    """
    try:
        contents = read_contents(path)
    except DamagedCampaign as error:
        said = "no resume can read it: restore a copy, or start afresh with --output"
        return f"{error}\n  {said}", FAILURE
    check_numbers(contents)
    digests = check_digests(contents)
    studied = contents.attributes.get("purpose") == STUDY
    replayed = None if studied else replay(contents)
    lines = [*_verified(contents, digests, replayed)]
    damage = [*contents.losses, *contents.faults]
    if damage:
        lines = [*damage, *_remedies(contents), *lines]
    text = "\n  ".join([f"{path}: {'damaged' if damage else 'sound'}", *lines])
    return text, FAILURE if damage else FINISHED


def _verified(
    contents: VerificationReport, digests: int, replayed: Replayed | None
) -> Iterator[str]:
    rows = {name: len(rows) for name, rows in contents.rows.items()}
    used = int(contents.rows["results"]["samples_used"].sum())
    fresh = rows["samples"] - len(contents.searched)
    kinds = f"{used} used, {fresh} fresh" if fresh else f"{used} used"
    yield (
        f"checksums: {pluralise(rows['strings'], 'string')}, "
        f"{pluralise(rows['results'], 'result')}, "
        f"{pluralise(rows['generations'], 'generation')}, {pluralise(rows['samples'], 'sample')} "
        f"({kinds}), {pluralise(rows['legs'], 'leg')} and {pluralise(rows['failures'], 'failure')} "
        "are whole"
    )
    names = {"final_particles": "final state", "frames": "frame"}
    counts = [pluralise(contents.counts[name], names[name]) for name in contents.counts]
    if counts:
        yield f"particles: {' and '.join(counts)} are whole"
    yield f"digests: {digests} of {pluralise(rows['generations'], 'generation')} verified"
    if replayed is None:
        yield f"replay: left out; the strings of an {STUDY} are not searched"
    else:
        yield (
            f"replay: the samples lead again to {replayed.strings} of "
            f"{pluralise(rows['strings'], 'string')}, {replayed.results} of "
            f"{pluralise(rows['results'], 'result')} and {replayed.generations} of "
            f"{pluralise(rows['generations'], 'population')}"
        )
    state, _, reason = contents.status
    yield f"{state}: {reason}" if reason else state


def _remedies(contents: VerificationReport) -> Iterator[str]:
    """Say what a resume would compute again, and what it would not."""
    lost, unused = dict(contents.lost), contents.unused
    lost["samples"] = lost["samples"] - unused
    again = [f"{what} {row_list(lost[name])}" for name, what in AGAIN.items() if lost[name]]
    if again:
        yield f"a resume would {', '.join(again)}"
    if unused:
        yield f"no result rests on {row_list(unused)}: only computed again if it comes to be needed"
    if contents.faults:
        yield (
            "a resume believes all rows with right checksums, and would not mend the rest: restore "
            "a copy, or start afresh with --output"
        )
