"""Pairs of bins of mass, merged until the standard errors of their coefficients are small.

Standard errors are those of a jackknife: blocks of samples are left out one by one.
"""

from typing import Final

import numpy as np
import numpy.typing as npt

Floats = npt.NDArray[np.float64]
Groups = npt.NDArray[np.int64]

MAX_ERROR: Final = 0.2
"""Maximum relative standard error of a collision efficiency, unless another one is given."""

LEAST_HITS: Final = 30
"""Minimum number of collisions of merged pairs: the error of fewer is not known either."""

LEAST_BLOCKS: Final = 3
"""Minimum number of blocks in which merged pairs have collisions."""


def merged_groups(hits: Floats, expected: Floats, widest: int, max_error: float) -> Groups:
    """Return the group of each pair of bins, shape (windows, bins, bins); −1 without one.

    A group is a pair whose efficiency is known well enough. The others are merged in squares of two
    by two bins, what is not known well enough then in squares of four by four, and so on.

    Parameters
    ----------
    hits, expected
        Collisions, and those of Maxwellian gases, without one block each, shape
        (blocks, windows, bins, bins).
    widest
        Maximum number of bins along the edge of a square.
    max_error
        Maximum relative standard error of the ratio of both.
    """
    found = np.full(hits.shape[1:], -1)
    places, width = np.argwhere(expected.any(axis=0)), 1
    while len(places) and width <= widest:
        numbers = np.ravel_multi_index((places // (1, width, width)).T, found.shape)
        _, square = np.unique(numbers, return_inverse=True)
        totals = _in_squares(hits, places, square), _in_squares(expected, places, square)
        kept = _is_known(*totals, max_error)[square]
        found[tuple(places[kept].T)] = found.max() + 1 + square[kept]
        places, width = places[~kept], 2 * width
    return found


def _in_squares(values: Floats, places: Groups, square: Groups) -> Floats:
    """Return sums over the places, (places, 3), of each square; shape (blocks, squares)."""
    return np.array([np.bincount(square, each) for each in values[:, *places.T]])


def _is_known(hits: Floats, expected: Floats, max_error: float) -> npt.NDArray[np.bool_]:
    """Return which squares have a small error; their sums without one block, (blocks, squares)."""
    whole, ratio = hits.sum(axis=0) / (len(hits) - 1), over(hits, expected)
    enough = whole > LEAST_HITS - 0.5
    enough &= np.count_nonzero(whole - hits > 0.5, axis=0) >= LEAST_BLOCKS
    return enough & (jackknife_error(ratio) <= max_error * ratio.mean(axis=0))


def pooled(values: Floats, groups: Groups) -> Floats:
    """Return the sum of the values of each one's group, nan without a group; of the same shape."""
    known = groups >= 0
    found = np.full(values.shape, np.nan)
    found[known] = np.bincount(groups[known], values[known])[groups[known]]
    return found


def over(sums: Floats, weights: Floats) -> Floats:
    """Return ratios, nan where there is nothing to divide by."""
    found = np.full(sums.shape, np.nan)
    np.divide(sums, weights, out=found, where=weights > 0.0)
    return found


def jackknife_error(without: Floats) -> Floats:
    """Return the standard error of estimates, without one block each, shape (blocks, …)."""
    count, spread = len(without), without - without.mean(axis=0)
    return np.asarray(np.sqrt((count - 1) / count * np.sum(spread**2, axis=0)))
