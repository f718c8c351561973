"""Samples that come before their turn wait, and come out in order."""

from examples import examples
from hypothesis import strategies as st
from search_fakes import completed
from summary_rows import rows_of

from agglom_mpi.outcome import summaries
from agglom_mpi.search.sample_paths import SampleBatch, SamplePart, WaitingSamples, gaps


@examples(200, st.lists(st.tuples(st.integers(0, 40), st.integers(1, 9))), st.integers(0, 30))
def test_gaps_are_what_no_run_holds(given, begin):
    batch = SampleBatch(rows_of([completed(2.0)]), summaries)
    runs, held = {}, set()
    for first, size in given:
        if held.isdisjoint(range(first, first + size)):
            runs[first] = SamplePart(batch, 100 + first, 100 + first + size)
            held |= {*range(first, first + size)}
    found = [sample for part in gaps(begin, begin + 12, runs) for sample in range(*part)]
    assert found == [sample for sample in range(begin, begin + 12) if sample not in held]


@examples(100, st.lists(st.tuples(st.integers(0, 40), st.integers(1, 9))), st.integers(1, 12))
def test_samples_that_wait_come_out_once_in_order_and_up_to_the_limit(given, step):
    batch = SampleBatch(rows_of([completed(2.0)]), summaries)
    waiting, used, came, out = WaitingSamples(), 0, set(), []
    for number, (first, size) in enumerate(given):
        waiting.add(7, first, SamplePart(batch, 1000 * number, 1000 * number + size), used)
        came |= {*range(first, first + size)}
        limit = used + step
        for part in waiting.take(7, used, limit):
            out += range(part.begin, part.end)
            used += part.end - part.begin
        assert used <= limit
        free = next(sample for sample in range(used, 60) if sample not in came)
        assert used == min(limit, free)
    assert len(set(out)) == len(out) == used
