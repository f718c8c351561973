"""A small campaign, and ranks that do with what a scheduler hands out whatever chance wants."""

from collections import Counter, deque
from functools import cache, partial

import numpy as np
from decision_log import DecisionLog
from goals import growth_target
from rules import difference
from searches import genetic_search
from summary_rows import rows_of

from agglom_mpi.outcome import SampleSummary
from agglom_mpi.scheduling.estimators import QUEUE_PROBABILITY
from agglom_mpi.scheduling.in_flight import MESSAGES_IN_FLIGHT
from agglom_mpi.scheduling.interface import MOST_SAMPLES, ReturnedPart
from agglom_mpi.scheduling.scheduler import GENERATIONS_AHEAD, MIN_PROBABILITY, Scheduler
from agglom_mpi.search.ending import Generations
from agglom_mpi.search.ensemble import Ensemble
from agglom_mpi.search.inversion import Inversion
from agglom_mpi.search.space import SearchSpace
from agglom_mpi.variables import TEN

MAX_SAMPLES = 9
GENERATIONS = 6
PATIENCE = 30.0


class Judge(Ensemble):
    """An ensemble that insists on samples of one string, each once and in order."""

    has_judge = False

    def __init__(self, max_samples, judged):
        super().__init__(difference(0.02, max_samples=max_samples), growth_target(), 100)
        self.has_judge = judged
        self._string = None

    def add(self, outcome):
        string, sample = outcome.particle_steps, outcome.steps
        assert sample == self.samples_used
        assert self._string in (None, string)
        self._string = string
        super().add(outcome)


class Decisions(DecisionLog):
    """What an inversion has decided, and which strings were proposed ahead."""

    def __init__(self):
        super().__init__()
        self.strings, self.generation_of, self.ahead = [], {}, {}

    def proposed_ahead(self, batch, ids):
        for string, parameters in zip(ids.tolist(), batch.parameters, strict=True):
            assert string not in self.ahead
            self.ahead[string] = parameters.tobytes()
            self.generation_of[string] = batch.generation

    def proposed(self, batch, ids):
        for string, parameters in zip(ids.tolist(), batch.parameters, strict=True):
            assert self.ahead.get(string, parameters.tobytes()) == parameters.tobytes()
            self.generation_of[string] = batch.generation
            self.strings.append((string, parameters.tobytes()))

    def everything(self):
        summaries = [(s.generation, s.best, s.population.tolist()) for s in self.summaries]
        return self.strings, sorted(self.results.items()), summaries


def campaign(
    rescale=None,
    generations=GENERATIONS,
    population=6,
    max_samples=MAX_SAMPLES,
    judged=False,
):
    space = SearchSpace(np.zeros(TEN.count), np.ones(TEN.count))
    search = genetic_search(space, seed=5, population=population, parents=2, rescale=rescale)
    ending = Generations(generations=generations)
    return Inversion(search, lambda string: Judge(max_samples, judged), ending), Decisions()


def scheduler_of(inversion, decisions, ranks, *known_and_used):
    """Return a scheduler whose strings ahead are among the decisions."""
    propose_ahead = partial(decisions.propose_ahead, inversion)
    return Scheduler(inversion, propose_ahead, ranks, *known_and_used)


@cache
def noise(key, sample):
    return np.random.default_rng([key, sample]).normal(1.0, 0.05)


def simulated(string, parameters, sample):
    """Return the outcome of a sample, a pure function of its string, with its number on it."""
    ratio = (1.0 + parameters[:2].sum()) * noise(int(1e6 * parameters[0]), sample)
    return SampleSummary(True, ratio, 50, (0.0, 0.0, 0.0), sample, string)


def in_order(rescale=None):
    """Decisions of a rank that simulates what is needed next, nothing else, without a scheduler."""
    inversion, decisions = campaign(rescale)
    decisions.record(inversion.start())
    while not inversion.finished:
        string, progress = next(iter(inversion.open_strings.items()))
        sample = progress.next_sample
        outcome = simulated(string, inversion.parameters(string), sample)
        decisions.record(inversion.complete(string, sample, rows_of([outcome])))
    return decisions.everything()


class World:
    """Ranks of which some sleep or die, and all that must hold whatever they do.

    Parameters
    ----------
    ranks
        Number of ranks; the last one lives for ever.
    chance
        Decides all that is open.
    typical
        Time of a sample in s.
    trouble
        Probability for a rank to fall asleep or to die, each time it is looked at.
    known
        {(string, sample): outcome} of an earlier leg.
    """

    def __init__(self, ranks, chance, typical=1e-3, trouble=0.0, known=None, **options):
        self.known = dict(known or {})
        self.inversion, self.decisions = campaign(**options)
        for (string, sample), outcome in self.known.items():
            self.decisions.record(self.inversion.complete(string, sample, rows_of([outcome])))
        self.decisions.record(self.inversion.start())
        used = [result.samples_used for result in self.inversion.results.values()]
        self.scheduler = scheduler_of(self.inversion, self.decisions, ranks, list(self.known), used)
        self.outcomes, self.cancelled = {}, set()
        self.handed, self.lost = Counter(), Counter()
        self._given_up = set()
        self._ranks, self._chance = ranks, chance
        self._typical, self._trouble = typical, trouble
        self.held = [deque() for _ in range(ranks)]
        self._left_out = [set() for _ in range(ranks)]
        self._dead, self._asleep, self._silent = set(), set(), set()
        self._now = 0.0

    def run(self, steps=100_000):
        """Let time pass until all is decided, or for so many steps."""
        for _ in range(steps):
            if self.inversion.finished:
                return self
            self._live_on()
            if self._chance.random() < 0.7:
                self.hand_out()
            working = [rank for rank in self._awake() if self.held[rank]]
            if working:
                self._give_back(self._chance.choice(working))
                if self._chance.random() < 0.7:
                    self._cancel()
            else:
                self._wait_for_those_who_are_not_heard()
        assert steps < 100_000, "it does not end"
        return self

    def _awake(self):
        return [r for r in range(self._ranks) if r not in self._dead and r not in self._asleep]

    def _live_on(self):
        """Time passes; ranks fall asleep, wake up or die."""
        chance = self._chance
        self._now += PATIENCE * chance.random() ** 3
        rank = chance.randrange(self._ranks)
        if rank in self._asleep and chance.random() < 0.3:
            self._asleep.discard(rank)
        if rank != self._ranks - 1 and chance.random() < self._trouble:
            (self._dead if chance.random() < 0.2 else self._asleep).add(rank)
        for rank in self._awake():
            if not self._trouble or chance.random() < 0.8:
                self._say_something(rank)
        if chance.random() < 0.3:
            self._look_at_the_clock()

    def _say_something(self, rank):
        was_silent = self.scheduler.in_flight.heartbeat(rank, self._now)
        assert was_silent == (rank in self._silent)
        self._silent.discard(rank)

    def _look_at_the_clock(self):
        for rank in self.scheduler.mark_silent(self._now, PATIENCE):
            assert self.held[rank]
            assert rank not in self._silent
            self._silent.add(rank)
            pairs = [pair for batch in self.held[rank] for pair in batch]
            self.lost.update(pairs)
            self._given_up.update(pairs)

    def _wait_for_those_who_are_not_heard(self):
        """They may be given work again, but not more than once each."""
        for _ in range(self._ranks):
            self._now += PATIENCE + 1.0
            for rank in self._awake():
                self._say_something(rank)
            self._look_at_the_clock()
            self.hand_out()
            if any(self.held[rank] for rank in self._awake()):
                return
        raise AssertionError("nobody has anything to do")

    def hand_out(self):
        """Let ranks have what the scheduler wants them to."""
        for rank, tasks in self.scheduler.assignments(self._now):
            assert rank not in self._silent
            assert len(self.held[rank]) == min(
                len(self.held[r]) for r in range(self._ranks) if r not in self._silent
            )
            batch = []
            for task in tasks:
                batch += self._check(
                    task, QUEUE_PROBABILITY if self.held[rank] else MIN_PROBABILITY
                )
            assert 1 <= len(batch) <= MOST_SAMPLES
            self.held[rank].append(deque(batch))
            assert len(self.held[rank]) <= MESSAGES_IN_FLIGHT
        assert self.scheduler.in_flight.samples == sum(len(b) for held in self.held for b in held)
        if any(not self.held[rank] for rank in range(self._ranks) if rank not in self._silent):
            self._check_that_nothing_useful_is_left()

    def _check(self, task, least):
        string, first, count = (int(task[name]) for name in ("string", "first", "count"))
        inversion, progress = self.inversion, self.inversion.progress(int(task["string"]))
        assert count >= 1
        assert task["frames"] == 0
        assert task["parameters"].tobytes() == inversion.parameters(string).tobytes()
        assert progress.next_sample <= first < first + count <= progress.max_samples
        assert 0 <= self.decisions.generation_of[string] - inversion.generation <= GENERATIONS_AHEAD
        waiting = self.waited_for()
        assert not waiting or (string, first) in waiting
        assert self.scheduler.sample_counts.probability(progress.next_sample, first) >= least
        batch = [(string, sample) for sample in range(first, first + count)]
        self.handed.update(batch)
        self._given_up.difference_update(batch)
        for pair in batch:
            assert pair not in self.known
            assert self.handed[pair] <= 1 + self.lost[pair]
        return batch

    def _free(self, pair):
        """Whether nobody simulates a sample that nobody has simulated."""
        missing = pair not in self.known and pair not in self.outcomes
        return missing and (not self.handed[pair] or pair in self._given_up)

    def waited_for(self):
        """Samples that decisions wait for and that are nobody's."""
        live = self.inversion.open_strings.items()
        return {pair for i, progress in live if self._free(pair := (i, progress.next_sample))}

    def _check_that_nothing_useful_is_left(self):
        """Of no string is there a sample that would be worth it."""
        for string in self.inversion.open_strings.keys() | self.decisions.ahead.keys():
            progress = self.inversion.progress(string)
            if progress is None:
                continue
            judged = progress.next_sample
            for sample in range(judged, progress.max_samples):
                if self._free((string, sample)):
                    assert (
                        self.scheduler.sample_counts.probability(judged, sample) < MIN_PROBABILITY
                    )
                    break

    def _give_back(self, rank):
        """A rank returns some of its next batch, and what it was the first to return is judged."""
        batch = self.held[rank][0]
        count = len(batch) if self._chance.random() < 0.5 else self._chance.randint(1, len(batch))
        while count > 0:
            string, first, size, *_ = next(self.scheduler.in_flight.ranges(rank))
            left_out = (string, first) in self._left_out[rank]
            done = 0 if left_out else min(size, count)
            turn = [batch.popleft() for _ in range(size if left_out else done)]
            assert turn == [(string, first + place) for place in range(len(turn))]
            self.scheduler.batch_sizer.learn([self._typical * self._chance.random()] * done)
            part = ReturnedPart(string, first, done, left_out)
            fresh = self.scheduler.returned(rank, part)
            found = [place for each in fresh for place in range(each.start, each.stop)]
            new = [pair not in self.outcomes for pair in turn[:done]]
            assert found == [place for place in range(done) if new[place]]
            self._judge(part, fresh)
            count -= len(turn)
        if not batch:
            self.held[rank].popleft()
        self._say_something(rank)

    def _cancel(self):
        """Ranks learn what they need not do; sometimes too late."""
        for rank, strings in self.scheduler.cancellations():
            assert rank not in self._silent
            for string in strings.tolist():
                assert self.inversion.progress(string) is None
                held = {pair for batch in self.held[rank] for pair in batch if pair[0] == string}
                assert held
                if self._chance.random() < 0.8:
                    self._left_out[rank] |= held
                    self.cancelled |= held

    def _judge(self, piece, fresh):
        parameters = self.inversion.parameters(piece.string)
        for places in fresh:
            first = piece.first + places.start
            new = [
                simulated(piece.string, parameters, sample)
                for sample in range(first, piece.first + places.stop)
            ]
            for sample, outcome in enumerate(new, first):
                self.outcomes[piece.string, sample] = outcome
            decided = self.inversion.complete(piece.string, first, rows_of(new))
            self.decisions.record(decided)
        self.scheduler.update(piece.string)
