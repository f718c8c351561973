"""Kernels of population balances, with standard errors, from counts of collisions.

Each coefficient is a ratio of sums over samples, so its error is that of a jackknife: blocks of
samples are left out one by one. A pair of bins with too few collisions has no coefficient.
"""

import math
from dataclasses import dataclass
from functools import cached_property
from typing import Any, Final, NamedTuple

import numpy as np
import numpy.typing as npt

from agglom_mpi.analysis.population_balance import Grid, Impacts, maxwellian_law, solve
from agglom_mpi.physics.impact_tests import ImpactTests
from agglom_mpi.physics.kinetic_theory import mixture_contact_values
from agglom_mpi.simulation.collision_counts import (
    BREAKS,
    ENERGY,
    HITS,
    LOST,
    LOST_BY_STICKS,
    MASS,
    NUMBER,
    SPEED,
    SQUARED_SPEED,
    SQUARED_SPEED_OF_STICKS,
    STICKS,
    CollisionCounts,
)
from agglom_mpi.simulation.impact import solve_impacts

Floats = npt.NDArray[np.float64]

BLOCKS: Final = 20
"""Blocks of samples that the jackknife leaves out one by one."""

LEAST_HITS: Final = 30
"""Collisions without which a pair of bins has no coefficient: its error would be 1/5 or more."""

LEAST_BLOCKS: Final = 3
"""Blocks that have collisions without which a pair of bins has no coefficient, as no error."""

COEFFICIENTS: Final = (
    *("rate", "efficiency", "sticking", "breakage"),
    *("speed", "squared_speed", "loss"),
)
"""Names of the coefficients of `CollisionKernels`."""


class Coefficient(NamedTuple):
    """A coefficient of each pair of bins with its standard error, shapes (windows, bins, bins).

    Both are nan where there are too few collisions, and below the diagonal.
    """

    value: Floats
    error: Floats


class BlockSums(NamedTuple):
    """Counts of collisions added up over the samples of each block.

    Attributes
    ----------
    impacts, exposure, pairs, pieces, start
        As in `CollisionCounts`, with the blocks as first axis.
    samples
        Number of samples, shape (blocks,).
    """

    impacts: Floats
    exposure: Floats
    pairs: Floats
    pieces: Floats
    start: Floats
    samples: npt.NDArray[np.int64]


def new_sums(counts: CollisionCounts, blocks: int = BLOCKS) -> BlockSums:
    """Return sums of no samples yet."""
    names = BlockSums._fields[:-1]
    zeros = {name: np.zeros((blocks, *getattr(counts, name).shape)) for name in names}
    return BlockSums(**zeros, samples=np.zeros(blocks, np.int64))


def add_sample(sums: BlockSums, block: int, counts: CollisionCounts) -> None:
    """Add the counts of a sample to a block."""
    for name in BlockSums._fields[:-1]:
        getattr(sums, name)[block] += getattr(counts, name)
    sums.samples[block] += 1


@dataclass(frozen=True, eq=False, repr=False)
class CollisionKernels:
    """Kernels of a string by bins of mass and windows of time.

    Attributes
    ----------
    sums
        Of the blocks of samples.
    masses : array, shape (bins,), kg
        In the middle of the bins, by logarithm.
    times : array, shape (windows + 1,), s
        Where windows begin and end.
    volume
        Of the box, m³.
    density
        Of the grains, kg/m³.
    grain_mass
        Of a mean grain, kg.
    failed
        Number of samples that failed, which are left out.
    tests
        The laws of the string.
    """

    sums: BlockSums
    masses: Floats
    times: Floats
    volume: float
    density: float
    grain_mass: float
    failed: int = 0
    tests: ImpactTests | None = None

    @cached_property
    def _whole(self) -> BlockSums:
        """Sums over all samples, without the axis of the blocks."""
        return BlockSums(*(each.sum(axis=0) for each in self.sums))

    @property
    def hits(self) -> Floats:
        """Number of collisions, shape (windows, bins, bins)."""
        return self._whole.impacts[..., HITS]

    @cached_property
    def rate(self) -> Coefficient:
        """Rate coefficient K in m³/s: K n_i n_j V collisions of unlike bins happen in a second."""
        return self._of_blocks(self._rates)

    @cached_property
    def efficiency(self) -> Coefficient:
        """Rate coefficient over that of two Maxwellian gases in Enskog's approximation.

        π(r_i + r_j)²√(8/π (T_i/m_i + T_j/m_j)) χ_ij with the partial temperatures of the window,
        T = m⟨v²⟩/3, and the contact values of Boublik, Mansoori, Carnahan, Starling and Leland.
        """
        return self._of_blocks(lambda sums: self._rates(sums) / self._maxwellian(sums))

    @cached_property
    def sticking(self) -> Coefficient:
        """Share of the collisions after which there is one particle."""
        return self._share(STICKS)

    @cached_property
    def sticking_by_law(self) -> Floats:
        """Share that sticks by the law if grains are Maxwellian, (windows, bins, bins).

        Of the partial temperatures and mean masses of the window; nan where there is no `rate`.
        """
        found = np.full(self.hits.shape, np.nan)
        radii, per_mass = self._states(self._whole)
        w, i, j = place = np.nonzero(np.isfinite(self.rate.value))
        if self.tests is not None:
            pairs = radii[w, i], radii[w, j], per_mass[w, i] + per_mass[w, j]
            found[place] = self.tests.maxwellian_sticking(*pairs, solve_impacts)
        return found

    @cached_property
    def breakage(self) -> Coefficient:
        """Share of the collisions that break a particle."""
        return self._share(BREAKS)

    @cached_property
    def speed(self) -> Coefficient:
        """Mean normal speed of the collisions in m/s."""
        return self._share(SPEED)

    @cached_property
    def squared_speed(self) -> Coefficient:
        """Mean square of the normal speed of the collisions in m²/s²."""
        return self._share(SQUARED_SPEED)

    @cached_property
    def loss(self) -> Coefficient:
        """Mean kinetic energy that a collision loses, J."""
        return self._share(LOST)

    @cached_property
    def numbers(self) -> Floats:
        """Mean number of particles of each bin in a sample, shape (windows, bins)."""
        duration = np.diff(self.times)[:, None] * self._whole.samples
        return np.asarray(self._whole.exposure[..., NUMBER] / duration)

    @property
    def breaks(self) -> bool:
        """Whether particles broke."""
        return bool(self.sums.impacts[..., BREAKS].any())

    @cached_property
    def means(self) -> Coefficient:
        """Mean number of particles and kinetic energy in J of a sample, shape (windows, 2)."""
        duration = np.diff(self.times)[:, None]

        def found(sums: BlockSums) -> Floats:
            totals = sums.exposure[..., [NUMBER, ENERGY]].sum(axis=1)
            return np.asarray(totals / (duration * sums.samples))

        return Coefficient(*self._jackknife(found))

    def balance(self) -> Floats:
        """Return the `means` that the Smoluchowski equations of numbers and energies give instead.

        They begin as the samples and take each window's efficiency, sticking and losses; where a
        pair has too few collisions, the mean of all pairs.

        Returns
        -------
        array, shape (windows, 2)

        Raises
        ------
        ValueError
            If particles broke, which is not in the equations.
        """
        if self.breaks:
            raise ValueError("particles broke; the equations have no breakage")
        grid, expected = Grid(self.masses), self._maxwellian(self._whole)
        numbers, _, energies = self._whole.start.T / self._whole.samples
        found = np.empty((len(self.times) - 1, 2))
        for w, duration in enumerate(np.diff(self.times).tolist()):
            impacts = self._impacts(grid, w, expected[w])
            law = maxwellian_law(grid, impacts, self.density, self.volume)
            n, e = solve(grid, law, numbers, energies, duration)
            for place, values in enumerate((n, e)):
                found[w, place] = np.trapezoid(values.sum(axis=0)) / (values.shape[1] - 1)
            numbers, energies = n[:, -1], e[:, -1]
        return found

    def _impacts(self, grid: Grid, w: int, maxwellian: Floats) -> Impacts:
        """Return the properties of the impacts of a window, of each pair or else of all.

        `maxwellian` are the rate coefficients of Maxwellian gases in m³/s, (bins, bins).
        """
        sums, (first, second) = self._whole, grid.pairs
        of_pairs = sums.impacts[w, first, second].T
        hits, sticks, squared, lost = of_pairs[[HITS, STICKS, SQUARED_SPEED, LOST]]
        per_mass = np.nan_to_num(_temperatures(sums.exposure[w])) / self.masses
        scale = per_mass[first] + per_mass[second]
        reduced = self.masses[first] * self.masses[second] / self.masses[grid.pairs].sum(axis=0)
        bounces, normal = hits - sticks, squared - of_pairs[SQUARED_SPEED_OF_STICKS]
        expected = (maxwellian * sums.pairs[w] / self.volume)[first, second]
        stuck = of_pairs[LOST_BY_STICKS]
        # The share of energy that is lost in an impact with the normal speed w is 1 − e².
        losses = _of_each(2.0 * (lost - stuck), reduced * normal, hits)
        return Impacts(
            _of_each(hits, expected, hits),
            _of_each(sticks, hits, hits),
            _of_each(normal, bounces * scale, hits),
            _of_each(2.0 * stuck, reduced * sticks * scale, hits),
            np.sqrt((1.0 - losses).clip(0.0)),
        )

    @cached_property
    def temperatures(self) -> Floats:
        """Partial granular temperatures m⟨v²⟩/3 in J, shape (windows, bins); nan without any."""
        return _temperatures(self._whole.exposure)

    def records(self) -> list[dict[str, Any]]:
        """Return a record for each window and pair of bins that has coefficients.

        A coefficient is a pair of value and standard error.
        """
        found = []
        for w, i, j in np.argwhere(np.isfinite(self.rate.value)).tolist():
            place = w, i, j
            record: dict[str, Any] = {"from": self.times[w], "to": self.times[w + 1]}
            for name, k in (("first", i), ("second", j)):
                record[f"{name}_mass"] = self.masses[k]
                record[f"{name}_particles"] = self.numbers[w, k]
                record[f"{name}_temperature"] = self.temperatures[w, k]
            record["collisions"] = int(self.hits[place])
            for name in COEFFICIENTS:
                value, error = getattr(self, name)
                record[name] = float(value[place]), float(error[place])
            if self.tests is not None:
                record["sticking_by_law"] = float(self.sticking_by_law[place])
            found.append(record)
        return found

    def _share(self, place: int) -> Coefficient:
        return self._of_blocks(
            lambda sums: _over(sums.impacts[..., place], sums.impacts[..., HITS])
        )

    def _of_blocks(self, function: Any) -> Coefficient:
        """Return the coefficients of pairs that have enough collisions."""
        value, error = self._jackknife(function)
        hits = self.sums.impacts[..., HITS]
        few = (hits.sum(axis=0) < LEAST_HITS) | (np.count_nonzero(hits, axis=0) < LEAST_BLOCKS)
        return Coefficient(np.where(few, np.nan, value), np.where(few, np.nan, error))

    def _jackknife(self, function: Any) -> tuple[Floats, Floats]:
        """Return what a function of sums gives of all samples, and its standard error."""
        used, whole = np.flatnonzero(self.sums.samples), self._whole
        value = function(whole)
        without = np.array(
            [
                function(BlockSums(*(a - b[k] for a, b in zip(whole, self.sums, strict=True))))
                for k in used
            ]
        )
        count = len(used)
        spread = without - without.mean(axis=0)
        error = np.sqrt((count - 1) / count * np.sum(spread**2, axis=0))
        return value, error

    def _rates(self, sums: BlockSums) -> Floats:
        return self.volume * _over(sums.impacts[..., HITS], sums.pairs)

    def radii(self, masses: Floats) -> Floats:
        """Return radii in m of masses in kg."""
        return np.asarray(np.cbrt(3.0 * masses / (4.0 * math.pi * self.density)))

    def _states(self, sums: BlockSums) -> tuple[Floats, Floats]:
        """Radii of the mean masses in m, and T/m in m²/s², each shape (windows, bins)."""
        with np.errstate(invalid="ignore", divide="ignore"):
            masses = np.where(
                sums.exposure[..., NUMBER] > 0.0,
                sums.exposure[..., MASS] / sums.exposure[..., NUMBER],
                self.masses,
            )
        return self.radii(masses), np.nan_to_num(_temperatures(sums.exposure)) / masses

    def _maxwellian(self, sums: BlockSums) -> Floats:
        """Rate coefficients of Maxwellian gases in m³/s, shape (windows, bins, bins)."""
        radii, per_mass = self._states(sums)
        duration = np.diff(self.times)[:, None] * sums.samples * self.volume
        densities = sums.exposure[..., NUMBER] / duration
        found = np.empty((*radii.shape, radii.shape[1]))
        for w, (r, n, t) in enumerate(zip(radii, densities, per_mass, strict=True)):
            speed = np.sqrt(8.0 / math.pi * np.add.outer(t, t))
            chi = mixture_contact_values(n, 2.0 * r)
            found[w] = math.pi * np.add.outer(r, r) ** 2 * speed * chi
        return found


def _temperatures(exposure: Floats) -> Floats:
    return _over(2.0 / 3.0 * exposure[..., ENERGY], exposure[..., NUMBER])


def _of_each(sums: Floats, weights: Floats, hits: Floats) -> Floats:
    """Return the ratio of each pair that has enough collisions; of others that of all sums."""
    whole = sums.sum() / weights.sum() if weights.sum() > 0.0 else 0.0
    enough = (hits >= LEAST_HITS) & (weights > 0.0)
    return np.asarray(np.divide(sums, weights, out=np.full(sums.shape, whole), where=enough))


def _over(sums: Floats, weights: Floats) -> Floats:
    """Return ratios, nan where there is nothing to divide by."""
    found = np.full(sums.shape, np.nan)
    np.divide(sums, weights, out=found, where=weights > 0.0)
    return found
