"""States of random generators are those that NumPy makes, and a generator takes them on."""

import ctypes
from types import SimpleNamespace

import numpy as np
import pytest

from agglom_mpi.random_streams import generator, key_words, sample_key, sample_stream
from agglom_mpi.simulation import stream_states
from agglom_mpi.simulation.stream_states import STATE_WORDS, WritableStream, fill_states

KEYS = [(0,), (1, 2), (2003, 1, 2, 3), (2**32 - 1, 0, 2**32), (2**70 + 5, 1, 0, 0, 0, 7)]


def states_of(key, first, count):
    states = np.zeros((count, STATE_WORDS), np.uint64)
    fill_states(key_words(key), np.uint64(first), states)
    return states


def state_of_numpy(key):
    numbers = generator(*key).bit_generator.state["state"]
    return [number >> shift & (1 << 64) - 1 for number in numbers.values() for shift in (0, 64)]


def test_states_are_those_of_numpy_for_thousands_of_keys():
    chance = np.random.default_rng(5)
    keys = [tuple(chance.integers(2**32, size=1 + k % 9).tolist()) for k in range(500)]
    for key in [*KEYS, *keys]:
        first = int(chance.integers(2**31))
        states = states_of(key, first, 4)
        wanted = [state_of_numpy((*key, first + k)) for k in range(4)]
        assert states.tolist() == wanted, key


@pytest.mark.parametrize("key", KEYS)
def test_a_sample_may_have_a_number_of_two_words(key):
    first = 2**32 - 2
    wanted = [state_of_numpy((*key, first + k)) for k in range(4)]
    assert states_of(key, first, 4).tolist() == wanted


@pytest.mark.parametrize("common", [False, True])
def test_a_writable_stream_draws_what_the_stream_of_the_sample_draws(common):
    stream, string = WritableStream(), np.linspace(0.1, 3.0, 10)
    states = states_of(sample_key(7, string, common), 0, 3)
    assert stream.is_open
    for sample, state in enumerate(states):
        stream.words[:] = state
        random = sample_stream(7, string, sample, common)
        assert stream.random.random(5).tolist() == random.random(5).tolist()
        assert stream.random.standard_normal(5).tolist() == random.standard_normal(5).tolist()
        assert stream.get().tolist() == stream.words.tolist()


def test_a_stream_that_is_set_forgets_half_of_a_number_drawn_before():
    stream, state = WritableStream(), states_of((1, 2), 0, 1)[0]
    stream.set(state)
    wanted = stream.random.integers(100, size=9, dtype=np.int32).tolist()
    stream.set(state)
    assert stream.random.integers(100, size=9, dtype=np.int32).tolist() == wanted


class Elsewhere:
    """NumPy's structure, if its words were others than those of the state."""

    @staticmethod
    def from_address(address):
        words = (ctypes.c_uint64 * STATE_WORDS)()
        return SimpleNamespace(words=SimpleNamespace(contents=words))


def test_a_state_that_numpy_keeps_elsewhere_is_not_written_in_place(monkeypatch):
    monkeypatch.setattr(stream_states, "_Pcg64State", Elsewhere)
    stream, state = WritableStream(), states_of((1, 2), 3, 1)[0]
    assert not stream.is_open
    stream.set(state)
    stream.words[:] = 0
    assert stream.get().tolist() == state.tolist()
    assert stream.random.random() == generator(1, 2, 3).random()
