"""Kernels of population balances, with standard errors, from counts of collisions.

Each coefficient is a ratio of sums over samples, so its error is that of a jackknife: blocks of
samples are left out one by one. Pairs of bins whose error is too large are merged
(`merged_pairs.py`); where it stays too large there is no coefficient.
"""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, Final, NamedTuple

import numpy as np
import numpy.typing as npt

from agglom_mpi.analysis.merged_pairs import (
    LEAST_HITS,
    MAX_ERROR,
    Groups,
    jackknife_error,
    merged_groups,
    over,
    pooled,
)
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

COEFFICIENTS: Final = (
    *("rate", "efficiency", "sticking", "breakage"),
    *("speed", "squared_speed", "loss"),
)
"""Names of the coefficients of `CollisionKernels`."""


class Coefficient(NamedTuple):
    """A coefficient of each pair of bins with its standard error, shapes (windows, bins, bins).

    Both are nan where the error is too large, and below the diagonal. Merged pairs have the same
    value; only their rates differ, as those of Maxwellian gases do.
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
    max_error
        Maximum relative standard error of an efficiency; pairs are merged until they have it.
    parameters
        The string: values and units of its variables by name.
    """

    sums: BlockSums
    masses: Floats
    times: Floats
    volume: float
    density: float
    grain_mass: float
    failed: int = 0
    tests: ImpactTests | None = None
    max_error: float = MAX_ERROR
    parameters: Mapping[str, tuple[float, str]] = field(default_factory=dict)

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
        return self._jackknife(lambda sums: self._efficiencies(sums) * self._maxwellian(sums))

    @cached_property
    def efficiency(self) -> Coefficient:
        """Rate coefficient over that of two Maxwellian gases in Enskog's approximation.

        π(r_i + r_j)²√(8/π (T_i/m_i + T_j/m_j)) χ_ij with the partial temperatures of the window,
        T = m⟨v²⟩/3, and the contact values of Boublik, Mansoori, Carnahan, Starling and Leland.
        """
        return self._jackknife(self._efficiencies)

    @cached_property
    def expected(self) -> Floats:
        """Numbers of collisions of Maxwellian gases, shape (windows, bins, bins)."""
        return self._expected(self._whole)

    @cached_property
    def mean_efficiency(self) -> Coefficient:
        """Efficiency of all pairs and windows together."""
        return self._jackknife(
            lambda sums: np.asarray(sums.impacts[..., HITS].sum() / self._expected(sums).sum())
        )

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

        return self._jackknife(found)

    @cached_property
    def pieces(self) -> Coefficient:
        """Shares by number of the pieces of a bin's particles that are in each bin.

        Shape (windows, bins, bins); nan where there are fewer than `LEAST_HITS` pieces.
        """
        few = self._whole.pieces.sum(axis=-1, keepdims=True) < LEAST_HITS

        def found(sums: BlockSums) -> Floats:
            whole = np.where(few, 0.0, sums.pieces.sum(axis=-1, keepdims=True))
            return over(sums.pieces, whole)

        return self._jackknife(found)

    @property
    def growth(self) -> Floats:
        """Factor by which the mean mass grows in each window where none breaks, (windows,)."""
        sticks = self._whole.impacts[..., STICKS].sum(axis=(1, 2))
        left = self._whole.start[:, NUMBER].sum() - np.cumsum([0.0, *sticks])
        return np.asarray(left[:-1] / left[1:])

    def balance(self) -> Floats:
        """Return the `means` that the Smoluchowski equations of numbers and energies give instead.

        They begin as the samples and take each window's efficiency, sticking and losses; of a pair
        without coefficients, the mean of all pairs.

        Returns
        -------
        array, shape (windows, 2)

        Raises
        ------
        ValueError
            If particles broke, which is not in the equations.
        RuntimeError
            If the equations cannot be integrated, as over too long a window.
        """
        if self.breaks:
            raise ValueError("particles broke; the equations have no breakage")
        grid = Grid(self.masses)
        numbers, _, energies = self._whole.start.T / self._whole.samples
        found = np.empty((len(self.times) - 1, 2))
        for w, duration in enumerate(np.diff(self.times).tolist()):
            law = maxwellian_law(grid, self._impacts(grid, w), self.density, self.volume)
            n, e = solve(grid, law, numbers, energies, duration)
            for place, values in enumerate((n, e)):
                found[w, place] = np.trapezoid(values.sum(axis=0)) / (values.shape[1] - 1)
            numbers, energies = n[:, -1], e[:, -1]
        return found

    def _impacts(self, grid: Grid, w: int) -> Impacts:
        """Return the properties of the impacts of a window, of each group or else of all."""
        sums, (first, second) = self._whole, grid.pairs
        of_pairs = sums.impacts[w, first, second].T
        hits, sticks, squared, lost = of_pairs[[HITS, STICKS, SQUARED_SPEED, LOST]]
        per_mass = np.nan_to_num(_temperatures(sums.exposure[w])) / self.masses
        scale = per_mass[first] + per_mass[second]
        reduced = self.masses[first] * self.masses[second] / self.masses[grid.pairs].sum(axis=0)
        bounces, normal = hits - sticks, squared - of_pairs[SQUARED_SPEED_OF_STICKS]
        expected = self.expected[w, first, second]
        stuck, groups = of_pairs[LOST_BY_STICKS], self.groups[w, first, second]
        # The share of energy that is lost in an impact with the normal speed w is 1 − e².
        losses = _of_each(2.0 * (lost - stuck), reduced * normal, groups)
        return Impacts(
            _of_each(hits, expected, groups),
            _of_each(sticks, hits, groups),
            _of_each(normal, bounces * scale, groups),
            _of_each(2.0 * stuck, reduced * sticks * scale, groups),
            np.sqrt((1.0 - losses).clip(0.0)),
        )

    @cached_property
    def temperatures(self) -> Floats:
        """Partial granular temperatures m⟨v²⟩/3 in J, shape (windows, bins); nan without any."""
        return _temperatures(self._whole.exposure)

    def records(self) -> list[dict[str, Any]]:
        """Return a record for each window and pair of bins that has coefficients.

        A coefficient is a pair of value and standard error; `merged_collisions` are those of all
        pairs that are merged with this one.
        """
        found, merged = [], pooled(self.hits, self.groups)
        for w, i, j in np.argwhere(np.isfinite(self.rate.value)).tolist():
            place = w, i, j
            record: dict[str, Any] = {"from": self.times[w], "to": self.times[w + 1]}
            for name, k in (("first", i), ("second", j)):
                record[f"{name}_mass"] = self.masses[k]
                record[f"{name}_particles"] = self.numbers[w, k]
                record[f"{name}_temperature"] = self.temperatures[w, k]
            record["collisions"] = int(self.hits[place])
            record["merged_collisions"] = int(merged[place])
            for name in COEFFICIENTS:
                value, error = getattr(self, name)
                record[name] = float(value[place]), float(error[place])
            if self.tests is not None:
                record["sticking_by_law"] = float(self.sticking_by_law[place])
            found.append(record)
        return found

    def piece_records(self) -> list[dict[str, Any]]:
        """Return a record for each window, bin of broken particles and bin of their pieces."""
        (value, error), found = self.pieces, []
        for w, k, p in np.argwhere(value > 0.0).tolist():
            record: dict[str, Any] = {"from": self.times[w], "to": self.times[w + 1]}
            record |= {"broken_mass": self.masses[k], "piece_mass": self.masses[p]}
            record["pieces"] = int(self._whole.pieces[w, k, p])
            record["share"] = float(value[w, k, p]), float(error[w, k, p])
            found.append(record)
        return found

    @cached_property
    def groups(self) -> Groups:
        """Numbers of the groups of merged pairs of bins, shape (windows, bins, bins); −1: none."""
        hits = self._without_blocks(lambda sums: sums.impacts[..., HITS])
        per_decade = int(np.count_nonzero(self.masses < 9.99 * self.masses[0]))
        return merged_groups(hits, self._without_blocks(self._expected), per_decade, self.max_error)

    def _share(self, place: int) -> Coefficient:
        return self._jackknife(
            lambda sums: over(
                pooled(sums.impacts[..., place], self.groups),
                pooled(sums.impacts[..., HITS], self.groups),
            )
        )

    def _jackknife(self, function: Callable[[BlockSums], Floats]) -> Coefficient:
        """Return what a function of sums gives of all samples, and its standard error."""
        return Coefficient(function(self._whole), jackknife_error(self._without_blocks(function)))

    def _without_blocks(self, function: Callable[[BlockSums], Floats]) -> Floats:
        """Return what a function of sums gives of all blocks but one each, shape (blocks, …)."""
        return np.array(
            [
                function(
                    BlockSums(*(a - b[k] for a, b in zip(self._whole, self.sums, strict=True)))
                )
                for k in np.flatnonzero(self.sums.samples)
            ]
        )

    def _efficiencies(self, sums: BlockSums) -> Floats:
        hits = pooled(sums.impacts[..., HITS], self.groups)
        return over(hits, pooled(self._expected(sums), self.groups))

    def _expected(self, sums: BlockSums) -> Floats:
        """Numbers of collisions of Maxwellian gases, shape (windows, bins, bins)."""
        return self._maxwellian(sums) * sums.pairs / self.volume

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
    return over(2.0 / 3.0 * exposure[..., ENERGY], exposure[..., NUMBER])


def _of_each(sums: Floats, weights: Floats, groups: Groups) -> Floats:
    """Return the ratio of each pair's group; without a group, that of all sums."""
    whole = sums.sum() / weights.sum() if weights.sum() > 0.0 else 0.0
    found = over(pooled(sums, groups), pooled(weights, groups))
    return np.where(np.isfinite(found), found, whole)
