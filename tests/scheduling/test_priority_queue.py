"""Strings in the order of their priorities, whatever was said of them before."""

from examples import examples
from hypothesis import strategies as st

from agglom_mpi.scheduling.estimators import PriorityQueue

PRIORITIES = st.sampled_from([0.0, 0.25, 0.5, 1.0])
EVENTS = st.lists(st.tuples(st.integers(0, 5), st.none() | PRIORITIES))


@examples(100, EVENTS)
def test_the_likeliest_is_first_and_of_equals_the_first(events):
    queue, priorities = PriorityQueue(), {}
    for string, priority in events:
        if priority is None:
            queue.remove(string)
            priorities.pop(string, None)
        else:
            queue.put(string, priority)
            priorities[string] = priority
        wanted = min(((-priority, string) for string, priority in priorities.items()), default=None)
        assert queue.first() == (None if wanted is None else (-wanted[0], wanted[1]))
