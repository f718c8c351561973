"""Strings in the order of their chances, whatever was said of them before."""

from examples import examples
from hypothesis import strategies as st

from agglom_mpi.scheduling.estimators import PriorityQueue

CHANCES = st.sampled_from([0.0, 0.25, 0.5, 1.0])
EVENTS = st.lists(st.tuples(st.integers(0, 5), st.none() | CHANCES))


@examples(100, EVENTS)
def test_the_likeliest_is_first_and_of_equals_the_first(events):
    ranking, chances = PriorityQueue(), {}
    for string, chance in events:
        if chance is None:
            ranking.drop(string)
            chances.pop(string, None)
        else:
            ranking.put(string, chance)
            chances[string] = chance
        wanted = min(((-chance, string) for string, chance in chances.items()), default=None)
        assert ranking.first() == (None if wanted is None else (-wanted[0], wanted[1]))
