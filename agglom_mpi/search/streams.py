"""Random streams of the search: each draw is keyed by what it is for, never by when it happens."""

from typing import Final

import numpy as np

# From 100 on, so that no search stream meets one of the simulation's under the same seed.
RANDOM_STRING: Final = 101
OFFSPRING_BLEND: Final = 102
SOBOL_SCRAMBLE: Final = 103
SURROGATE: Final = 104
EVOLUTION: Final = 105
SENSITIVITY: Final = 106


def stream(seed: int, *key: int) -> np.random.Generator:
    """Return the generator that belongs to a campaign seed and a key.

    Parameters
    ----------
    seed
        Seed of the campaign, not negative.
    key
        Purpose first, then what tells draws of that purpose apart: generation, slot. Keys of
        one purpose must have one length, for a seed sequence does not see trailing zeros.
    """
    return np.random.Generator(np.random.PCG64(np.random.SeedSequence([seed, *key])))
