"""How growth and the published objective change with the control volume."""

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from agglom_mpi.accuracy.report import (
    TIME,
    TIME_COLUMN,
    ReportSection,
    Sentences,
    frame_table,
    mean_column,
)
from agglom_mpi.accuracy.soundness import summary
from agglom_mpi.accuracy.study import Rows, Setup, StudyPart, completed
from agglom_mpi.accuracy.time_integration.published_method import event_engine
from agglom_mpi.accuracy.time_integration.steps import EVENT, StudiedScene
from agglom_mpi.analysis.finite_size import FiniteSize, growth_of_many, means_of_rows, why_no_limit
from agglom_mpi.display.table import Column
from agglom_mpi.report.figures.fresh_estimates import draw_finite_size
from agglom_mpi.report.style import Drawing

if TYPE_CHECKING:
    pass

FACTORS: Final = (0.125, 0.25, 0.5, 2.0, 4.0, 8.0)
"""Numbers of particles to compare, over the scene's own."""
QUICK_FACTORS: Final = (0.5, 2.0)
FEWEST_PARTICLES: Final = 8
"""Smaller numbers of particles are left out."""


def compared_numbers(scene: StudiedScene) -> dict[int, str]:
    """Return the set-ups of the numbers of particles to compare with the scene's own, ascending."""
    own = scene.campaign.scene.particles
    wanted = {round(own * factor) for factor in (QUICK_FACTORS if scene.quick else FACTORS)}
    return {n: f"{n} particles" for n in sorted(wanted) if n >= FEWEST_PARTICLES and n != own}


def control_volume_part(scene: StudiedScene) -> StudyPart:
    """Return the part on the number of particles.

    With another number of particles the box is as much larger, so that grains, volume fraction and
    end time stay what they are, and only the control volume changes.
    """
    engine, own = event_engine(scene.campaign), scene.campaign.scene
    setups: dict[str, Setup] = {}
    for number, name in compared_numbers(scene).items():
        changes: dict[str, object] = {"particles": number, "end_time": scene.end_time}
        if own.half_width is not None:  # it follows from the size of the grains otherwise
            changes["half_width"] = own.half_width * (number / own.particles) ** (1.0 / 3.0)
        setups[name] = scene.setup(None, engine=engine, **changes)
    return StudyPart(setups, lambda samples: _section(scene, samples))


def _section(scene: StudiedScene, samples: Mapping[str, Rows]) -> ReportSection:
    import pandas as pd

    own, size = scene.campaign.scene.particles, finite_size(scene, samples)
    names = {**compared_numbers(scene), own: EVENT}
    sizes = pd.DataFrame([_row(scene, n, samples[name]) for n, name in sorted(names.items())])
    sentences = Sentences(
        "control_volume",
        particles=own,
        size=size,
        why_no_limit=size and why_no_limit(size.volumes, size.growth),
        failed=[row for _, row in sizes[sizes["failed"] > 0].iterrows()],
    )
    figures = []
    if size is not None:
        caption = (
            "Mean growth against 1/N with 95 % intervals; the diamond is the limit of many grains."
        )
        ranked = [("mean b/b⁰", size)]
        drawn = Drawing(
            "box_finite_size", caption, lambda figure: draw_finite_size(figure.subplots(), ranked)
        )
        figures.append(drawn)
    table = frame_table(sizes, "One row is one number of particles.", "box_particles", BOX_COLUMNS)
    return sentences.section("Control volume", figures, [table])


def finite_size(scene: StudiedScene, samples: Mapping[str, Rows]) -> FiniteSize | None:
    """Return the means in all boxes, the scene's own first, and their limit for many grains.

    None where too many samples failed.
    """
    own = scene.campaign.scene.particles
    names = {own: EVENT, **compared_numbers(scene)}
    found = [means_of_rows(samples[name], 1, number) for number, name in names.items()]
    usable = tuple(each for each in found if each is not None)
    if len(usable) < 2 or usable[0].grains != own:
        return None
    return FiniteSize(0, usable, growth_of_many(usable), None)


def _row(scene: StudiedScene, particles: int, rows: Rows) -> dict[str, Any]:
    good = completed(rows)
    ratios = good["mean_radius_ratio"]
    grains = particles * scene.campaign.scene.third_moment
    value, error = scene.campaign.objective.of_grains(grains).of_rows(good)
    spread, found = float(np.std(ratios, ddof=1)) if len(ratios) > 1 else np.nan, summary(rows)
    return {
        "particles": particles,
        **found,
        "spread of samples": spread,
        "time × variance (s)": found[TIME] * spread**2,
        "objective": value,
        "standard error of the objective": error,
    }


BOX_COLUMNS: Final = (
    Column("particles", "N"),
    Column("samples"),
    mean_column("mean b/b⁰", "mean b/b0", "standard error", "samples"),
    Column("spread of samples", "spread of one sample", format=".2g"),
    Column("time × variance (s)", format=".2g"),
    mean_column("objective", "objective", "standard error of the objective", "samples"),
    TIME_COLUMN,
)
