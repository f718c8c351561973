"""States of the random generators of consecutive samples, and a generator that takes them on.

A sample's stream is `PCG64(SeedSequence(key))`, whose last key is the sample's number (see
`random_streams`). Made by NumPy it takes a tenth of the time of a short sample; here the same
states are computed for many samples at once, and written into one generator.
"""

import ctypes
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from agglom_mpi.compilation.kernels import kernel
from agglom_mpi.compilation.stages import inlined

STATE_WORDS: Final = 4
"""Words of 64 bits of a state: state and increment of PCG64, each the lower half first."""

_POOL: Final = 4
_LOW: Final = np.uint64(0xFFFFFFFF)
_HALF: Final = np.uint64(32)
_SHIFT: Final = np.uint64(16)
_CARRY: Final = np.uint64(1 << 32)
_ONE: Final = np.uint64(1)
_BEGIN_POOL: Final = np.uint64(0x43B0D7E5)
_NEXT_POOL: Final = np.uint64(0x931E8875)
_BEGIN_STATE: Final = np.uint64(0x8B51F9DD)
_NEXT_STATE: Final = np.uint64(0x58F38DED)
_MIX_LEFT: Final = np.uint64(0xCA01F9DD)
_MIX_RIGHT: Final = np.uint64(0x4973F715)
"""Constants of `SeedSequence`, INIT_A, MULT_A, INIT_B, MULT_B, MIX_MULT_L and MIX_MULT_R there."""

_MULTIPLIER: Final = tuple(
    np.uint64(limb) for limb in (0x9FCCF645, 0x4385DF64, 0x1FC65DA4, 0x2360ED05)
)
"""Multiplier of PCG64, in limbs of 32 bits, the lowest first."""


@kernel
def fill_states(words, first, states):
    """Compute the states of the streams of consecutive samples, as NumPy seeds `PCG64`.

    Parameters
    ----------
    words : array of uint64, shape (w + 2,)
        From `random_streams.key_words`; the last two are written.
    first : uint64
        Number of the first sample.
    states : array of uint64, shape (n, `STATE_WORDS`), filled
    """
    pool = np.empty(_POOL, np.uint64)
    seed = np.empty(2 * _POOL, np.uint64)
    limbs = np.empty((2, 4), np.uint64)
    last = len(words) - 2
    for k in range(len(states)):
        number = first + np.uint64(k)
        words[last], words[last + 1] = number & _LOW, number >> _HALF
        mix_pool(pool, words, len(words) if words[last + 1] > 0 else last + 1)
        expand_pool(pool, seed)
        begin_generator(seed, limbs, states[k])


@inlined
def hashed(value, constant, following):
    """Mix a word with two constants of a hash, the second following the first."""
    value = ((value ^ constant) * following) & _LOW
    return value ^ (value >> _SHIFT)


@inlined
def mixed(one, other):
    """Mix two words into one."""
    value = ((one * _MIX_LEFT) & _LOW) + _CARRY - ((other * _MIX_RIGHT) & _LOW)
    value = value & _LOW
    return value ^ (value >> _SHIFT)


@inlined
def mix_pool(pool, words, count):
    """Mix `count` words into the pool, as `SeedSequence` does."""
    constant = _BEGIN_POOL
    for i in range(_POOL):
        following = (constant * _NEXT_POOL) & _LOW
        pool[i] = hashed(words[i] if i < count else np.uint64(0), constant, following)
        constant = following
    for source in range(max(count, _POOL)):
        for i in range(_POOL):
            if source != i:
                following = (constant * _NEXT_POOL) & _LOW
                word = pool[source] if source < _POOL else words[source]
                pool[i] = mixed(pool[i], hashed(word, constant, following))
                constant = following


@inlined
def expand_pool(pool, seed):
    """Fill the words of a seed, as `SeedSequence.generate_state`."""
    constant = _BEGIN_STATE
    for i in range(len(seed)):
        following = (constant * _NEXT_STATE) & _LOW
        seed[i] = hashed(pool[i % _POOL], constant, following)
        constant = following


@inlined
def begin_generator(seed, limbs, state):
    """Write state and increment of a `PCG64` with a seed of eight words of 32 bits.

    The increment is twice the sequence and 1, the state (increment + start) · multiplier +
    increment, all modulo 2¹²⁸.
    """
    start, increment = limbs[0], limbs[1]
    for i in range(4):
        start[i] = seed[(2 + i) % 4]  # the upper half comes first
        increment[i] = seed[4 + (2 + i) % 4]
    carry = _ONE
    for i in range(4):
        twice = (increment[i] << _ONE) + carry
        increment[i], carry = twice & _LOW, twice >> _HALF
    state[2] = increment[0] | (increment[1] << _HALF)
    state[3] = increment[2] | (increment[3] << _HALF)
    carry = np.uint64(0)
    for i in range(4):
        total = start[i] + increment[i] + carry
        start[i], carry = total & _LOW, total >> _HALF
    for i in range(4):  # the increment's limbs take up the product
        carry = np.uint64(0)
        for j in range(4 - i):
            total = start[i] * _MULTIPLIER[j] + increment[i + j] + carry
            increment[i + j], carry = total & _LOW, total >> _HALF
    state[0] = increment[0] | (increment[1] << _HALF)
    state[1] = increment[2] | (increment[3] << _HALF)


class _Pcg64State(ctypes.Structure):
    """NumPy's structure of that name, in `numpy/random/src/pcg64/pcg64.h`."""

    _fields_ = (
        ("words", ctypes.POINTER(ctypes.c_uint64 * STATE_WORDS)),
        ("has_uint32", ctypes.c_int),
        ("uinteger", ctypes.c_uint32),
    )


class WritableStream:
    """A generator of random numbers whose state kernels can set.

    Attributes
    ----------
    random
        The generator.
    words
        Its state in place, shape (`STATE_WORDS`,).
    is_open
        Whether `words` are where NumPy keeps the state; else only `set` changes it.
    """

    def __init__(self) -> None:
        self._bits: Any = np.random.PCG64(0)
        self.random = np.random.Generator(self._bits)
        found = _Pcg64State.from_address(self._bits.ctypes.state_address)
        self.words: NDArray[np.uint64] = np.frombuffer(found.words.contents, np.uint64)
        self.is_open = self._has_known_layout()
        if not self.is_open:
            self.words = np.zeros(STATE_WORDS, np.uint64)

    def set(self, state: NDArray[np.uint64]) -> None:
        """Begin a stream at its state, shape (`STATE_WORDS`,)."""
        value, increment = (int(state[i]) | int(state[i + 1]) << 64 for i in (0, 2))
        self._bits.state = {
            "bit_generator": "PCG64",
            "state": {"state": value, "inc": increment},
            "has_uint32": 0,
            "uinteger": 0,
        }

    def get(self) -> NDArray[np.uint64]:
        """Return the state, shape (`STATE_WORDS`,)."""
        numbers = self._bits.state["state"]
        halves = (number >> shift for number in numbers.values() for shift in (0, 64))
        return np.array([half & 0xFFFFFFFFFFFFFFFF for half in halves], np.uint64)

    def _has_known_layout(self) -> bool:
        """Return whether the words in place are read and written as NumPy's own state."""
        states = np.arange(1, 2 * STATE_WORDS + 1, dtype=np.uint64).reshape(2, STATE_WORDS)
        self.set(states[0])
        is_read = np.array_equal(self.words, states[0])
        if is_read:
            self.words[:] = states[1]
        return is_read and np.array_equal(self.get(), states[1])
