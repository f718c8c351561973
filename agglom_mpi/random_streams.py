"""Random streams: each draw is keyed by its purpose, never by when it happens.

All keys begin with the seed of the campaign and a purpose; no two purposes share a stream.
"""

import hashlib
from typing import Final

import numpy as np
from numpy.typing import NDArray

SAMPLE: Final = 1
"""Purpose of a sample's stream: placement and velocities of one string and sample number."""
COMMON_SAMPLE: Final = 2
"""Purpose of a sample's stream that all strings share (common configurations)."""
VOLUME_SAMPLE: Final = 3
COMMON_VOLUME_SAMPLE: Final = 4
"""Purposes of the same two in a larger control volume, whose factor follows in the key."""
RANDOM_STRING: Final = 101
OFFSPRING_BLEND: Final = 102
SOBOL_SCRAMBLE: Final = 103
SURROGATE: Final = 104
EVOLUTION: Final = 105
SENSITIVITY: Final = 106
ALLOWED_SHARE: Final = 107
CONSEQUENCES: Final = 108
FEASIBLE_SET: Final = 109
PLACEMENT_FORECAST: Final = 110
OWN_SEARCH: Final = 111
DATA_POSTERIOR: Final = 112
NEXT_MEASUREMENT: Final = 113
CERTIFICATE: Final = 114
"""Purposes of the search's streams; from 100 on, so that none meets one of the samples."""


def generator(*key: int) -> np.random.Generator:
    """Return the random generator of a key, whose first number is the seed of the campaign."""
    return np.random.Generator(np.random.PCG64(np.random.SeedSequence(key)))


def key_words(key: tuple[int, ...]) -> NDArray[np.uint64]:
    """Return the words of 32 bits that NumPy makes of a key, with room for a sample's number.

    Parameters
    ----------
    key
        What precedes the number of the sample, none negative.

    Returns
    -------
    array, shape (w + 2,)
        The last two are 0.
    """
    words: list[int] = []
    for number in key:
        words.append(number & 0xFFFFFFFF)
        while number := number >> 32:
            words.append(number & 0xFFFFFFFF)
    return np.array([*words, 0, 0], np.uint64)


def search_stream(seed: int, *key: int) -> np.random.Generator:
    """Return the random generator of one purpose of the search.

    Parameters
    ----------
    seed
        Seed of the campaign, not negative.
    key
        Purpose first, then what tells draws of that purpose apart: generation, slot. Keys of
        one purpose must have one length, for a seed sequence does not see trailing zeros.
    """
    return generator(seed, *key)


def experiment_seed(seed: int, experiment: str) -> int:
    """Return the seed of the samples of an experiment: that of its campaign, and its name, alone.

    So its samples are the same whatever other experiments there are.
    """
    digest = hashlib.blake2b(f"{seed}:{experiment}".encode(), digest_size=8).digest()
    return int.from_bytes(digest, "little") >> 1


def sample_key(
    seed: int, parameters: NDArray[np.float64], common: bool = False, volume: int = 1
) -> tuple[int, ...]:
    """Return what the keys of all samples of a string begin with; the sample's number follows.

    Parameters
    ----------
    seed
        Seed of the campaign, not negative.
    parameters
        Numbers that the string's samples depend on, in SI units, shape (k,).
    common
        Whether all strings share configurations; the key then leaves the parameters out.
    volume
        Control volume relative to the campaign's box.
    """
    if common:
        return (seed, COMMON_SAMPLE) if volume == 1 else (seed, COMMON_VOLUME_SAMPLE, volume)
    purpose = (SAMPLE,) if volume == 1 else (VOLUME_SAMPLE, volume)
    digest = hashlib.blake2b(np.asarray(parameters, "<f8").tobytes(), digest_size=16).digest()
    return seed, *purpose, *np.frombuffer(digest, "<u4").tolist()


def sample_stream(
    seed: int,
    parameters: NDArray[np.float64],
    sample: int,
    common: bool = False,
    volume: int = 1,
) -> np.random.Generator:
    """Return the random generator of one sample, keyed by seed, string and sample number.

    Arguments as for `sample_key`, and the sample's number from 0.
    """
    return generator(*sample_key(seed, parameters, common, volume), sample)
