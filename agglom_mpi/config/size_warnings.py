"""Warnings about laws of sizes whose samples differ from what is asked."""

import math
from collections.abc import Iterator
from typing import TYPE_CHECKING, Final

import numpy as np
import numpy.typing as npt

from agglom_mpi.declaration.declared import FieldPath
from agglom_mpi.formatting import format_percent, pluralise
from agglom_mpi.physics.size_distributions import Floats, SizeDistribution, draw_radii
from agglom_mpi.random_streams import PLACEMENT_FORECAST, search_stream
from agglom_mpi.variables import volume_fraction

if TYPE_CHECKING:
    from agglom_mpi.config.scene import SceneSection

Finding = tuple[FieldPath, str]
"""A field, and what is unlikely about it."""

MOST_FILLED: Final = 0.6
"""Volume fraction of drawn sizes above which placement mostly jams; below it hardly ever does.

Of 1700 samples of lognormal and uniform laws with 50 to 1000 grains, 25 of 33 jammed above 0.6, or
with a grain as wide as the box, and 1 of 508 between 0.3 and 0.6.
"""
MAX_DRAWN_SAMPLES: Final = 4000
MAX_DRAWN_GRAINS: Final = 4_000_000
"""Maximum numbers of samples, and of their grains, whose sizes are drawn to count those that jam;
a fifth of a second."""
MIN_DRAWN_SAMPLES: Final = 30
"""Minimum number of drawn samples for a warning about a law of sizes."""
MISSING_VOLUME: Final = 0.01
"""Relative loss of volume fraction, beyond two standard errors, above which a law is too wide."""
MAX_SCATTER: Final = 0.2
"""Relative standard deviation of the volume fractions of samples above which there is a warning."""


def unlikely_draws(scene: "SceneSection", seed: int, size_ratio: float) -> Iterator[Finding]:
    """Yield the law of sizes if samples that draw from it differ from what is asked.

    `size_ratio` is the largest of the campaign.
    """
    wanted = volume_fraction(size_ratio, scene.third_moment)
    if scene.size_law is None:
        return
    samples = min(MAX_DRAWN_SAMPLES, MAX_DRAWN_GRAINS // scene.particles)
    enough = samples >= MIN_DRAWN_SAMPLES
    fractions, fits = _drawn_fractions(scene, seed, wanted, samples if enough else 0)
    yield from _scatter(scene, scene.size_law, fractions / wanted)
    if enough:
        yield from _placement(scene, wanted, fractions, fits)


def _scatter(scene: "SceneSection", law: SizeDistribution, drawn: Floats) -> Iterator[Finding]:
    """Yield the law of sizes if the volume of the grains varies too much between samples.

    `drawn` are volume fractions of samples over what is asked, (n,).
    """
    deviation = law.volume_deviation(scene.particles)
    if deviation > MAX_SCATTER:
        most = ""
        if len(drawn):
            low, high = np.quantile(drawn, (0.05, 0.95))
            most = f", 90 % of them {low:.2g} to {high:.2g} times it"
        needed = math.ceil(scene.particles * (deviation / MAX_SCATTER) ** 2)
        message = (
            f"give samples of {pluralise(scene.particles, 'grain')} a volume fraction with a "
            f"standard deviation of {format_percent(deviation)} of what is asked{most}; few large "
            f"grains have most of the volume, so {format_percent(MAX_SCATTER)} needs {needed:,} "
            "grains or a narrower law"
        )
        yield ("scene", "sizes"), message


def _placement(
    scene: "SceneSection", wanted: float, fractions: Floats, fits: npt.NDArray[np.bool_]
) -> Iterator[Finding]:
    """Yield the law of sizes if it is so wide that the largest draws find no place.

    `fractions` are volume fractions of drawn samples, (n,); `fits` marks those that find a place.
    """
    completed = fractions[fits]
    if not len(completed):
        message = f"make all samples fail: their grains fill more than {MOST_FILLED:g} of the box"
        yield ("scene", "sizes"), message
        return
    missing = wanted - completed.mean()
    error = completed.std() / math.sqrt(len(completed))
    if missing > MISSING_VOLUME * wanted + 2.0 * error:
        message = (
            f"make about {format_percent(1.0 - float(fits.mean()))} of samples fail, whose "
            f"{scene.particles:,} grains fill more than {MOST_FILLED:g} of the box or include one "
            f"as wide as the box; the completed samples fill {completed.mean():.3g} of it on "
            f"average, not {wanted:.3g}"
        )
        yield ("scene", "sizes"), message


def _drawn_fractions(
    scene: "SceneSection", seed: int, wanted: float, samples: int
) -> tuple[Floats, npt.NDArray[np.bool_]]:
    """Return the volume fractions of drawn samples, (n,), and which of them find a place, (n,)."""
    random = search_stream(seed, PLACEMENT_FORECAST)
    fractions, fits = np.empty(samples), np.empty(samples, np.bool_)
    unit = wanted / scene.third_moment  # volume fraction of grains of the mean radius
    for k in range(samples):
        ratios = draw_radii(scene.size_law, random, scene.particles)
        fractions[k] = unit * np.mean(ratios**3)
        widest = (
            unit / scene.particles * ratios[0] ** 3
        )  # over the box, 0.52 of which a sphere fills
        fits[k] = fractions[k] <= MOST_FILLED and widest < math.pi / 6.0
    return fractions, fits
