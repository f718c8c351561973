"""The figures of a campaign file: one table for the page and for the `plot_*` methods."""

from typing import Final

from agglom_mpi.report.figures.cloud import CLOUD
from agglom_mpi.report.figures.convergence import CONVERGENCE, COST
from agglom_mpi.report.figures.data_fit import DATA_FIT
from agglom_mpi.report.figures.ensembles import ENSEMBLES, SAMPLES_PER_STRING
from agglom_mpi.report.figures.figure import Figure
from agglom_mpi.report.figures.finalists import FINALISTS
from agglom_mpi.report.figures.finite_size import FINITE_SIZE
from agglom_mpi.report.figures.growth import GROWTH
from agglom_mpi.report.figures.radii import RADII
from agglom_mpi.report.figures.search_space import BEST_STRINGS, SEARCH_PATHS, SENSITIVITY
from agglom_mpi.report.figures.utilisation import UTILISATION

FIGURES: Final[dict[str, Figure]] = {
    figure.name: figure
    for figure in (
        DATA_FIT,
        GROWTH,
        FINALISTS,
        FINITE_SIZE,
        CONVERGENCE,
        SEARCH_PATHS,
        BEST_STRINGS,
        COST,
        SENSITIVITY,
        RADII,
        CLOUD,
        ENSEMBLES,
        SAMPLES_PER_STRING,
        UTILISATION,
    )
}
"""Figures by name, in the order in which each section of the page shows them."""
