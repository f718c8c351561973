"""How far a run is, as rank 0 knows it."""

import time

from agglom_mpi.farm.books import Books
from agglom_mpi.farm.chores import Chore
from agglom_mpi.farm.work import Work
from agglom_mpi.report.left import rest_left, turns_left
from agglom_mpi.report.progress import Progress
from agglom_mpi.search import Inversion


def of_search(
    work: Work, inversion: Inversion, books: Books, ranks: int, in_flight: int
) -> Progress:
    """Tell how far the search is; `in_flight` samples are with the ranks."""
    stage = work.stage(inversion)
    left = turns_left(books.laps, stage.total - stage.done, books.lap) if stage.in_turns else None
    return _everywhere(books, ranks, in_flight)._replace(
        done=stage.done,
        total=stage.total,
        unit=stage.unit,
        strings_open=len(inversion.live),
        left=left,
        at_most=stage.may_end_sooner,
    )


def of_chore(chore: Chore, begun: float, books: Books, ranks: int) -> Progress:
    """Tell how far a chore is that began at a time of the monotonic clock."""
    stage = chore.stage
    rest, done = stage.total - stage.done, stage.done - chore.done_before
    return _everywhere(books, ranks, chore.errands.in_flight)._replace(
        done=stage.done,
        total=stage.total,
        unit=stage.unit,
        left=rest_left(books.fresh_costs, done, rest, time.monotonic() - begun),
    )


def _everywhere(books: Books, ranks: int, in_flight: int) -> Progress:
    """Tell what is the same in every phase."""
    elapsed = books.elapsed
    return Progress(
        done=0,
        total=0,
        unit="",
        elapsed=elapsed,
        samples=books.all_samples,
        rate=books.rate if books.samples else None,
        busy=books.busy_seconds / (elapsed * ranks) if books.samples else None,
        in_flight=in_flight,
        failed=books.failed,
        best=books.best,
    )
