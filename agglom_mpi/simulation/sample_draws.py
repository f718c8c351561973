"""Random numbers of consecutive samples: a stream for each, and the sizes drawn from it first."""

import sys
import threading
from collections.abc import Iterator, Sequence
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from agglom_mpi.physics.size_distributions import draw_radii
from agglom_mpi.simulation.scene import Scene
from agglom_mpi.simulation.stream_states import STATE_WORDS, WritableStream, fill_states


class Draws(NamedTuple):
    """Random numbers of n samples.

    Attributes
    ----------
    words
        State of the generator, in place; see `WritableStream`.
    states
        State that each sample begins with, shape (n, `STATE_WORDS`); (0, …): the generator's own.
    radii, masses
        Those of the grains of each sample, the largest first, m and kg, shape (n, N); (0, 0) where
        all grains are equal.
    """

    words: NDArray[np.uint64]
    states: NDArray[np.uint64]
    radii: NDArray[np.float64]
    masses: NDArray[np.float64]


def new_draws(
    words: NDArray[np.uint64] | None = None, states: NDArray[np.uint64] | None = None
) -> Draws:
    """Return draws of equal grains; without states those of one sample, from any generator."""
    return Draws(
        np.zeros(STATE_WORDS, np.uint64) if words is None else words,
        np.zeros((0, STATE_WORDS), np.uint64) if states is None else states,
        np.zeros((0, 0)),
        np.zeros((0, 0)),
    )


def with_sizes(
    draws: Draws, drawn: Sequence[tuple[NDArray[np.float64], NDArray[np.float64]] | None]
) -> Draws:
    """Return draws with radii and masses of the grains of each sample; of None as they are."""
    different = [sizes for sizes in drawn if sizes is not None]
    if not different:
        return draws
    radii, masses = (np.array(each) for each in zip(*different, strict=True))
    return draws._replace(radii=radii, masses=masses)


MAX_DRAWN_GRAINS: Final = 65_536
"""Maximum number of grains whose sizes are drawn for the samples of one call."""


def samples_at_once(scene: Scene) -> int:
    """Return the maximum number of samples of one call of `simulate_samples`."""
    if not thread_stream().is_open:
        return 1
    return sys.maxsize if scene.sizes is None else max(1, MAX_DRAWN_GRAINS // scene.particles)


def draws_of(
    scene: Scene, stream: WritableStream, words: NDArray[np.uint64], first: int, count: int
) -> tuple[Draws, int]:
    """Return the draws of consecutive samples, and of how many.

    These are fewer where a law of sizes raises for one that is not the first.

    Parameters
    ----------
    scene
        Their scene.
    stream
        The stream that takes on their states.
    words
        Key of their streams, from `random_streams.key_words`.
    first, count
        Number of the first sample, and of samples, at most `samples_at_once`.

    Raises
    ------
    Exception
        Whatever a law of sizes of the user's raises for the first sample.
    """
    states = np.empty((count, STATE_WORDS), np.uint64)
    fill_states(words, np.uint64(first), states)
    draws = new_draws(stream.words, states)
    if scene.sizes is not None:
        draws = with_sizes(draws, list(drawn_in_order(scene, stream, states)))
        count = len(draws.radii)
    elif not stream.is_open:
        stream.set(states[0])
    return (draws if stream.is_open else draws._replace(states=states[:0])), count


def drawn_in_order(
    scene: Scene, stream: WritableStream, states: NDArray[np.uint64]
) -> Iterator[tuple[NDArray[np.float64], NDArray[np.float64]]]:
    """Yield radii and masses of the grains of each sample, and leave what its stream goes on with.

    They end before a sample for which the law raises, unless it is the first.
    """
    for k, state in enumerate(states):
        stream.set(state)
        try:
            drawn = drawn_sizes(scene, stream.random)
        except Exception:
            if k == 0:
                raise
            return
        state[:] = stream.get()
        assert drawn is not None
        yield drawn


def drawn_sizes(
    scene: Scene, random: np.random.Generator
) -> tuple[NDArray[np.float64], NDArray[np.float64]] | None:
    """Return radii in m and masses in kg of the grains, shape (N,) each, the largest first.

    None where all are equal, and nothing is drawn.
    """
    if scene.sizes is None:
        return None
    radii = scene.radius * draw_radii(scene.sizes, random, scene.particles)
    return radii, scene.mass * (radii / scene.radius) ** 3


_per_thread = threading.local()


def thread_stream() -> WritableStream:
    """Return the stream of this thread."""
    if not hasattr(_per_thread, "stream"):
        _per_thread.stream = WritableStream()
    stream: WritableStream = _per_thread.stream
    return stream
