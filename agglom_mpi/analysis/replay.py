"""Replay of the decisions of a campaign from its stored samples."""

from collections.abc import Callable, Iterable, Iterator, Mapping
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from agglom_mpi.analysis.resimulation import samples_that_differ
from agglom_mpi.analysis.warm_start import evaluated
from agglom_mpi.config.campaign import Campaign
from agglom_mpi.config.inversion import inversion_of
from agglom_mpi.config.own_components import own_of
from agglom_mpi.config.searchable import check_search_library
from agglom_mpi.config.yaml_source import CampaignError
from agglom_mpi.declaration.reading import SOURCE_VALUES
from agglom_mpi.errors import MissingLibraryError
from agglom_mpi.outcome import FAILED
from agglom_mpi.search.ensemble import EnsembleResult
from agglom_mpi.search.inversion import Inversion
from agglom_mpi.search.proposals import (
    MODEL,
    Decision,
    GenerationSummary,
    Proposals,
    StringEvaluated,
)
from agglom_mpi.statistics import Floats
from agglom_mpi.storage.reader import given_strings
from agglom_mpi.storage.recorded_campaign import allowed_function, recorded_campaign
from agglom_mpi.storage.schema import parameters_of
from agglom_mpi.storage.table import consecutive_samples
from agglom_mpi.storage.verify import VerificationReport, row_list

T = TypeVar("T")


Replayed = tuple[int, int, int]
"""Numbers of stored strings, results and generations that the replay gives again."""


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


def replay(report: VerificationReport) -> Replayed:
    """Repeat all decisions from the stored samples, as a resume does, and compare.

    Faults, and absent rows that decisions rest on, are added to the report. Nothing is simulated.

    Raises
    ------
    MissingLibraryError
        If the search needs a library that is not installed.
    """
    try:
        data = report.data
        allowed, campaign = allowed_function(data), recorded_campaign(data)
        _check_campaign(campaign, report)
        campaign = campaign.with_generations(_generations(report))
        check_search_library(campaign)
        log, inversion = _rerun_decisions(campaign, report)
        if allowed is not None or any(own_of(campaign)):
            report.faults.extend(samples_that_differ(data, campaign))
    except MissingLibraryError:
        raise
    except (
        CampaignError,
        ArithmeticError,
        LookupError,
        RuntimeError,
        TypeError,
        ValueError,
    ) as error:
        report.faults.append(f"replay: not possible: {error}")
        return 0, 0, 0
    strings, results = _compare_strings(log, report), _compare_results(log, report)
    counts = strings, results, _compare_generations(log, report)
    _check_end(inversion, log, report)
    return counts


def _generations(report: VerificationReport) -> int:
    """Return how many generations to replay: all that there is room for, or strings are stored of.

    In a compact copy there is no room for the generation that the campaign was stopped in.
    """
    proposed = report.data.string_rows()["generation"].tolist()
    return max([report.room["generations"], *(number + 1 for number in proposed)])


def _check_campaign(campaign: Campaign, report: VerificationReport) -> None:
    """Add a fault if the text of the campaign does not agree with the file's attributes."""
    data, wanted = report.data, campaign.identity()
    # A file made before values of own modules were part of the identity has none.
    unknown = {k for k in wanted.keys() - data.identity.keys() if f".{SOURCE_VALUES}." in k}
    is_other = not unknown and campaign.sha256() != data.attributes["campaign_sha256"]
    if is_other or {k: v for k, v in wanted.items() if k not in unknown} != data.identity:
        report.faults.append("campaign: the text in the file is not that of its identity")
    if (campaign.seed, campaign.title) != tuple(
        report.data.attributes[n] for n in ("seed", "title")
    ):
        report.faults.append("attributes: another seed or title than in the campaign's text")
    # A file of an earlier version has no columns of spins.
    known = campaign.sample_quantities, dict(campaign.objective.quantity_units)
    if report.data.sizes.quantities not in known:
        report.faults.append("attributes: other quantities than in the campaign's text")
    rows, box = data.variable_rows(), campaign.variables
    described = [
        [(each.name, each.unit, each.meaning) for each in variables.further]
        for variables in (data.variables, box)
    ]
    if described[0] != described[1]:
        report.faults.append("attributes: other further variables than in the campaign's text")
    bounds = (rows["lower"], box.lower), (rows["upper"], box.upper)
    same = all(np.array_equal(*pair, equal_nan=True) for pair in bounds)
    if not same or not np.array_equal(rows["searched"], box.lower < box.upper):
        report.faults.append("variables: another box than in the campaign's text")


def _rerun_decisions(campaign: Campaign, report: VerificationReport) -> tuple[ReplayLog, Inversion]:
    log = ReplayLog()

    def restore(batch: Proposals, first: int) -> Proposals:
        log.batches.append((np.arange(first, first + len(batch.parameters)), batch))
        return report.data.restore(batch, first)

    learned = evaluated(campaign, report.data.learned_rows())
    inversion = inversion_of(campaign, _given(campaign, report), restore, learned=learned)
    log.record(inversion.start())
    stored = report.data.searched_samples
    # A run may have simulated strings ahead of their generation.
    strings = report.data.string_rows()
    last = np.minimum(strings["generation"], strings["string"]).max(initial=0)
    for samples in stored_outcomes(stored, report.data.judged_timed_out):
        _propose_ahead(inversion, last)
        log.record(inversion.complete(*samples))
    _propose_ahead(inversion, last)
    return log, inversion


def _propose_ahead(inversion: Inversion, last: int) -> None:
    """Let a search propose what it knows of generations up to `last` already."""
    while inversion.propose_ahead(last - inversion.generation) is not None:
        pass


def _given(campaign: Campaign, report: VerificationReport) -> Floats:
    """Return the strings that the search began with, as they are stored, shape (n, k).

    Where a row is lost, the middle of the box takes its place, so that the others keep theirs.
    """
    earlier = campaign.search.earlier
    if earlier is None:
        return campaign.given_strings()
    given = np.tile(campaign.parameters(), (earlier.strings, 1))
    stored = given_strings(report.data.string_rows())
    stored = stored[stored["slot"] < earlier.strings]
    given[stored["slot"]] = parameters_of(stored)
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


def _compare_strings(log: ReplayLog, report: VerificationReport) -> int:
    stored = {int(row["string"]): row for row in report.data.string_rows()}
    parameters = report.data.parameters
    same: set[int] = set()
    other: set[int] = set()  # some strings are proposed ahead, and again
    for ids, batch in log.batches:
        believed = report.ranked_by_model and MODEL in batch.origin
        for i, string in enumerate(ids.tolist()):
            row = stored.get(string)
            if row is None:
                continue
            agrees = string < report.data.strings_of_earlier_data or (
                row["generation"] == batch.generation
                and row["slot"] == batch.slot[i]
                and row["origin"] == batch.origin[i]
                and np.array_equal(row["parents"], batch.parents[i])
                and (believed or _close(parameters[string], batch.parameters[i]))
            )
            (same if agrees else other).add(string)
    if other:
        report.faults.append(f"replay: the search proposes other strings than {row_list(other)}")
    return len(same - other)


def _compare_results(log: ReplayLog, report: VerificationReport) -> int:
    def agrees(row: np.void, result: EnsembleResult) -> bool:
        return all(_close(row[name], value) for name, value in result._asdict().items())

    stored = {int(row["string"]): row for row in report.data.result_rows()}
    same, other = _compare(log.results, stored, agrees)
    if other:
        report.faults.append(f"replay: the samples give other results of strings {row_list(other)}")
    if report.settled:
        absent = log.results.keys() - stored.keys()
        report.add_absent("results", absent, "though the samples judge their strings")
    return same


def _compare_generations(log: ReplayLog, report: VerificationReport) -> int:
    def agrees(row: np.void, done: GenerationSummary) -> bool:
        counts = (row["evaluations"], row["samples_used"]) == (done.evaluations, done.samples_used)
        return counts and (report.ranked_by_model or _ranks_agree(row, done))

    stored = {int(row["generation"]): row for row in report.data.generation_rows()}
    same, other = _compare(log.summaries, stored, agrees)
    if other:
        report.faults.append(f"replay: the search ends otherwise in generations {row_list(other)}")
    if report.settled:
        absent = log.summaries.keys() - report.generations
        report.add_absent("generations", absent, "though all their strings are judged")
    return same


def _compare(
    decided: Mapping[int, T], stored: Mapping[int, np.void], agrees: Callable[[np.void, T], bool]
) -> tuple[int, list[int]]:
    """Return how many stored rows agree with what was decided, and the numbers of the others."""
    both = [i for i in decided if i in stored]
    other = [i for i in both if not agrees(stored[i], decided[i])]
    return len(both) - len(other), other


def _ranks_agree(row: np.void, done: GenerationSummary) -> bool:
    stored = [row[name] for name in ("best_objective", "best_standard_error", "mean_of_top")]
    return (
        row["best_string"] == done.best
        and np.array_equal(row["population"], done.population)
        and _close(stored, [done.objective, done.standard_error, done.mean_of_top])
    )


def _check_end(inversion: Inversion, log: ReplayLog, report: VerificationReport) -> None:
    """Add a fault if there are results beyond the end of the replay, unless rows are lost."""
    if any(report.lost.values()):
        return
    beyond = set(inversion.open_strings) & report.numbers("results")
    if report.settled:  # a proposal need not wait until the samples behind it are written
        proposed = {int(i) for ids, _ in log.batches for i in ids}
        chosen_before = range(report.data.strings_of_earlier_data)
        beyond |= report.numbers("strings") - proposed - {*chosen_before}
    if beyond:
        report.faults.append(f"replay: ends before strings {row_list(beyond)}, which are stored")
    if (
        report.settled
        and report.data.status().state == "finished"
        and not report.generations  # with fewer generations asked for, later ones may have begun
    ):
        report.faults.append("status: finished, but the search is not")


def _close(stored: object, decided: object) -> bool:
    """Return whether numbers agree but for the last digits, which depend on the processor."""
    left, right = np.asarray(stored, float), np.asarray(decided, float)
    return bool(np.allclose(left, right, rtol=1e-9, atol=1e-12, equal_nan=True))
