"""The scheduler as a state machine: whatever ranks do, the same is decided, and nobody starves."""

import random
from functools import cache

import pytest
from examples import examples
from hypothesis import strategies as st
from returned_parts import give_back
from scheduler_worlds import (
    MAX_SAMPLES,
    PATIENCE,
    World,
    campaign,
    in_order,
    scheduler_of,
    simulated,
)
from summary_rows import rows_of

from agglom_mpi.scheduling.estimators import BATCH_SECONDS, ROUND_TRIP_SECONDS
from agglom_mpi.scheduling.in_flight import MESSAGES_IN_FLIGHT
from agglom_mpi.scheduling.interface import MOST_SAMPLES
from agglom_mpi.scheduling.scheduler import GENERATIONS_AHEAD

RANKS = st.integers(1, 9)
SEEDS = st.integers(0, 2**32)
SECONDS = st.integers(-7, 4).map(lambda decade: 10.0**decade)
RESCALE = st.sampled_from([None, (2, 0.5)])


wanted = cache(in_order)


@examples(100, RANKS, SEEDS, SECONDS, RESCALE)
def test_every_schedule_ends_with_the_same_decisions(ranks, seed, typical, rescale):
    """Each sample is handed out once, in the order of its string, and no needed one is left out."""
    world = World(ranks, random.Random(seed), typical, rescale=rescale).run()
    assert world.decisions.everything() == wanted(rescale)
    assert set(world.handed.values()) == {1}
    by_string = {}
    for string, sample in world.handed:
        assert sample == by_string.get(string, 0)
        by_string[string] = sample + 1
    for string, result in world.decisions.results.items():
        assert result[3] <= by_string[string]  # samples_used


@examples(150, RANKS, SEEDS, SECONDS, RESCALE, st.sampled_from([0.02, 0.1, 0.5]))
def test_ranks_that_die_or_are_late_change_no_decision(ranks, seed, typical, rescale, trouble):
    world = World(ranks, random.Random(seed), typical, trouble, rescale=rescale).run()
    assert world.decisions.everything() == wanted(rescale)


def test_in_these_worlds_samples_are_cancelled():
    worlds = [World(9, random.Random(seed), 1.0).run() for seed in range(6)]
    assert sum(len(world.cancelled) for world in worlds) > 6


def test_samples_of_ranks_that_fell_silent_are_handed_out_again_and_come_back_twice():
    handed, lost = 0, 0
    for seed in range(5):
        world = World(4, random.Random(seed), trouble=0.3).run()
        handed += sum(count - 1 for count in world.handed.values())
        lost += world.lost.total()
    assert 25 < handed <= lost


@examples(100, RANKS, SEEDS, SECONDS, RESCALE, st.integers(0, 120), st.floats(0.0, 1.0))
def test_known_samples_are_never_handed_out(ranks, seed, typical, rescale, steps, share):
    """Nor those of coming generations; and the second leg decides what one would have."""
    chance = random.Random(seed)
    leg = World(ranks, chance, typical, 0.1, rescale=rescale).run(steps)
    known = {pair: outcome for pair, outcome in leg.outcomes.items() if chance.random() < share}
    world = World(ranks, chance, typical, 0.1, known, rescale=rescale).run()
    assert known.keys().isdisjoint(world.handed)
    assert world.decisions.everything() == wanted(rescale)


def test_a_leg_leaves_samples_of_generations_that_had_not_come():
    leg = World(9, random.Random(1)).run(60)
    coming = {leg.decisions.generation_of[string] for string, _ in leg.outcomes}
    assert max(coming) > leg.inversion.generation


def test_idle_ranks_do_strings_of_coming_generations_but_not_of_any():
    world = World(9, random.Random(0), generations=20)
    for _ in range(9 * MAX_SAMPLES * 20):
        world.hand_out()
    ahead = {world.decisions.generation_of[string] for string in world.decisions.ahead}
    assert ahead == set(range(1, GENERATIONS_AHEAD + 1))
    while not world.inversion.finished:
        world.run(1)
        announced = max(map(world.decisions.generation_of.get, world.decisions.ahead))
        assert announced <= world.inversion.generation + GENERATIONS_AHEAD
    assert len(world.decisions.ahead) == 19 * 2, "the random strings of all generations but one"


def test_no_string_of_a_box_that_is_not_known_yet_is_announced():
    world = World(9, random.Random(0), rescale=(2, 0.5))
    while not world.inversion.finished:
        world.run(1)
        generation = world.inversion.generation
        ahead = {world.decisions.generation_of[string] for string in world.decisions.ahead}
        assert all(coming // 2 <= generation // 2 for coming in ahead)
    assert ahead == {1, 3, 5}


def size(scheduler):
    """Entries of all that a scheduler keeps, but for its experience."""
    kept = [value for value in vars(scheduler).values() if hasattr(value, "__len__")]
    inner = [v for value in kept if isinstance(value, dict) for v in value.values()]
    return sum(map(len, kept)) + sum(len(v) for v in inner if hasattr(v, "__len__"))


def test_memory_does_not_grow_with_the_number_of_generations():
    world = World(3, random.Random(0), generations=60)
    sizes = [0] * 60
    while not world.inversion.finished:
        generation = world.inversion.generation
        world.run(1)
        sizes[generation] = max(sizes[generation], size(world.scheduler))
    assert max(sizes[25:]) <= max(sizes[:25])


def test_samples_that_ranks_fell_silent_with_are_remembered_while_a_rank_holds_them():
    most, lost = 0, 0
    for seed in range(3):
        world = World(4, random.Random(seed), trouble=0.1, generations=20)
        while not world.inversion.finished:
            world.run(1)
            held = {pair for batches in world.held for batch in batches for pair in batch}
            assert len(world.scheduler.duplicates) <= len(held)
            most = max(most, len(world.scheduler.duplicates))
        lost += world.lost.total()
    assert 0 < 5 * most < lost, "it is no test if hardly any come back"


def test_the_string_that_is_nearest_to_its_result_comes_first():
    inversion, decisions = campaign()
    decisions.record(inversion.start())
    scheduler = scheduler_of(inversion, decisions, 1)
    batches = [tasks[["string", "first"]].tolist() for _, tasks in scheduler.assignments(0.0)]
    assert batches == [[(0, 0)], [(1, 0)]]
    give_back(scheduler, 0, 1)
    first = rows_of([simulated(0, inversion.parameters(0), 0)])
    decisions.record(inversion.complete(0, 0, first))
    scheduler.update(0)
    [(_, tasks)] = scheduler.assignments(0.0)
    assert tasks[["string", "first"]].tolist()[0] == (0, 1)


PLENTY = {"population": 400, "max_samples": 1000, "experience": [1000]}


def batches_of(ranks, seconds, experience=(), round_trip=ROUND_TRIP_SECONDS, **options):
    """Ranks and numbers of samples of the batches handed out when samples take so long."""
    inversion, decisions = campaign(**options)
    decisions.record(inversion.start())
    scheduler = scheduler_of(inversion, decisions, ranks, (), experience)
    scheduler.batch_sizer.round_trip = round_trip
    first = [rank for rank, _ in scheduler.assignments(0.0)]
    scheduler.batch_sizer.learn([seconds])
    for rank in first:
        give_back(scheduler, rank, 1)
    assert scheduler.in_flight.samples == 0
    return [(rank, int(tasks["count"].sum())) for rank, tasks in scheduler.assignments(0.0)]


def test_a_rank_gets_no_more_than_it_can_hold():
    batches = batches_of(2, 1e-3, **PLENTY)
    assert [rank for rank, _ in batches] == [0, 1] * MESSAGES_IN_FLIGHT


def test_short_samples_travel_together_and_long_ones_alone():
    times = {1e-9: MOST_SAMPLES, BATCH_SECONDS / 20.5: 20, BATCH_SECONDS: 1, 10.0: 1}
    for seconds, wanted in times.items():
        assert {count for _, count in batches_of(1, seconds, **PLENTY)} == {wanted}


def test_a_rank_that_has_long_samples_is_not_tied_down():
    for seconds, batches in ((10.0, 1), (0.5, 2)):
        assert len(batches_of(3, seconds, **PLENTY)) == 3 * batches


@pytest.mark.parametrize(("round_trip", "batches"), [(1e-3, 2), (1e-5, 1), (0.0, 1)])
def test_ranks_hold_the_less_the_sooner_they_get_more(round_trip, batches):
    assert len(batches_of(3, 1e-3, round_trip=round_trip, **PLENTY)) == 3 * batches


def test_more_ranks_than_samples_leave_some_without_work():
    inversion, decisions = campaign()
    decisions.record(inversion.start())
    scheduler = scheduler_of(inversion, decisions, 1000)
    tasks = [task for _, batch in scheduler.assignments(0.0) for task in batch]
    announced = len(decisions.ahead)
    assert announced == GENERATIONS_AHEAD * 2
    assert sum(int(task["count"]) for task in tasks) == (6 + announced) * MAX_SAMPLES
    assert max(int(task["first"]) for task in tasks) == MAX_SAMPLES - 1
    assert scheduler.in_flight.next_rank(0) is not None


def test_what_a_decision_waits_for_comes_before_what_a_silent_rank_held_ahead():
    inversion, decisions = campaign()
    decisions.record(inversion.start())
    scheduler = scheduler_of(inversion, decisions, 2)
    held = {rank: [] for rank in range(2)}
    for rank, tasks in scheduler.assignments(0.0):
        held[rank] += tasks[["string", "first"]].tolist()
    scheduler.in_flight.heartbeat(1, 100.0)
    assert scheduler.mark_silent(100.0, PATIENCE) == [0]
    scheduler.batch_sizer.learn([1e-3])
    give_back(scheduler, 1, len(held[1]))
    again = [
        pair
        for _, tasks in scheduler.assignments(100.0)
        for pair in tasks[["string", "first"]].tolist()
    ]
    assert again == sorted(held[0])


def complete_of_three(string):
    """A scheduler with three ranks that hold samples of a string which is complete then."""
    inversion, decisions = campaign()
    decisions.record(inversion.start())
    scheduler = scheduler_of(inversion, decisions, 3)
    held = [(rank, batch["string"].tolist()) for rank, batch in scheduler.assignments(0.0)]
    outcomes = [simulated(string, inversion.parameters(string), i) for i in range(MAX_SAMPLES)]
    decisions.record(inversion.complete(string, 0, rows_of(outcomes)))
    assert inversion.progress(string) is None
    return scheduler, {rank for rank, strings in held if string in strings}


@pytest.mark.parametrize("by", ["a sample of its own", "a race"])
def test_what_ranks_hold_of_a_complete_string_is_cancelled_once(by):
    scheduler, holders = complete_of_three(1)
    scheduler.batch_sizer.learn([10.0])
    if by == "a sample of its own":
        scheduler.update(1)
    told = scheduler.cancellations()
    assert {rank for rank, _ in told} == holders != set()
    assert all(strings.tolist() == [1] for _, strings in told)
    assert scheduler.cancellations() == []


def test_when_all_is_decided_everything_is_cancelled():
    inversion, decisions = campaign()
    decisions.record(inversion.start())
    scheduler = scheduler_of(inversion, decisions, 3)
    held = {
        (rank, string)
        for rank, batch in scheduler.assignments(0.0)
        for string in batch["string"].tolist()
    }
    scheduler.batch_sizer.learn([10.0])
    scheduler.cancel_all()
    told = {(rank, i) for rank, strings in scheduler.cancellations() for i in strings.tolist()}
    assert told == held


def test_samples_that_are_done_before_a_message_arrives_are_not_cancelled():
    scheduler, _ = complete_of_three(1)
    scheduler.batch_sizer.learn([0.9 * ROUND_TRIP_SECONDS])
    scheduler.update(1)
    assert scheduler.cancellations() == []


def test_a_silent_rank_is_sent_no_cancellation():
    scheduler, holders = complete_of_three(1)
    scheduler.batch_sizer.learn([10.0])
    assert set(scheduler.mark_silent(100.0, PATIENCE)) >= holders
    scheduler.update(1)
    assert scheduler.cancellations() == []


@pytest.mark.parametrize("used", [[], [2, 2, 3, 3, 9, 9, 9]])
def test_a_string_that_data_make_likelier_to_be_needed_keeps_its_place(used):
    inversion, decisions = campaign()
    decisions.record(inversion.start())
    scheduler = scheduler_of(inversion, decisions, 1, (), used)
    handed = set()
    for _ in range(200):
        for rank, tasks in scheduler.assignments(0.0):
            for string, first, count in tasks[["string", "first", "count"]].tolist():
                handed |= {(string, first + i) for i in range(count)}
            scheduler.batch_sizer.learn([1.0])
            give_back(scheduler, rank, int(tasks["count"].sum()))
            scheduler.sample_counts.learn(MAX_SAMPLES)
    live = {pair for pair in handed if pair[0] < 6}
    assert len(live) == 6 * MAX_SAMPLES
