"""Sets of samples against Python's own sets."""

import numpy as np
from examples import examples
from hypothesis import strategies as st

from agglom_mpi.scheduling.in_flight import SampleRange
from agglom_mpi.scheduling.static_scheduler import SampleSet

parts = st.builds(SampleRange, st.integers(0, 3), st.integers(0, 20), st.integers(0, 9))
pairs = st.tuples(st.integers(0, 5), st.integers(0, 40))


def numbers(part):
    return [(part.string, part.first + place) for place in range(part.size)]


@examples(100, st.lists(parts), st.lists(pairs), st.data())
def test_it_holds_what_a_set_of_pairs_holds(given_parts, dropped, data):
    peer = {key for part in given_parts for key in numbers(part)}
    held = SampleSet(given_parts)
    assert len(held) == len(peer)
    held.discard(*np.array(dropped, np.int64).reshape(-1, 2).T)
    peer.difference_update(dropped)
    assert len(held) == len(peer)
    if given_parts:
        part = data.draw(st.sampled_from(given_parts))
        assert [key for run in held.runs_in(part) for key in numbers(run)] == [
            key for key in numbers(part) if key in peer
        ]
        assert held.take(part).tolist() == [key in peer for key in numbers(part)]
        peer.difference_update(numbers(part))
    assert len(held) == len(peer)
    found = [key for run in held.runs() for key in numbers(run)]
    assert len(found) == len(peer)
    assert set(found) == peer
