"""The pictures of one run, and its file for ParaView: what `agglom simulate --frames` writes."""

from pathlib import Path
from typing import TYPE_CHECKING, Final

import numpy as np

from agglom_mpi.errors import require_library
from agglom_mpi.report.export import check_directory
from agglom_mpi.report.figures.cloud import cloud_size, draw_cloud
from agglom_mpi.report.figures.evolution import draw_evolution, evolution, evolution_size
from agglom_mpi.report.picture import Picture, write_picture
from agglom_mpi.report.vtkhdf import SUFFIX, write_vtkhdf
from agglom_mpi.simulation.frames import Frames
from agglom_mpi.storage.files import require_absent

if TYPE_CHECKING:
    from matplotlib.figure import Figure

PANELS: Final = 9
"""Frames that the picture of the cloud shows at most."""
NAMES: Final = (
    "cloud.png",
    "cloud.svg",
    "evolution.png",
    "evolution.svg",
    f"particles{SUFFIX}",
)
"""The files that are written."""


def check_room(directory: Path) -> None:
    """Make sure, before anything is simulated, that the pictures can be drawn and written.

    Raises
    ------
    ExportError, MissingLibraryError
        If the directory is something else, or matplotlib is missing.
    FileExistsError
        If one of the files is there already.
    """
    require_library("matplotlib", "report", "pictures")
    check_directory(directory)
    for name in NAMES:
        require_absent(directory / name)


def write_run(directory: Path, frames: Frames, half_width: float, title: str) -> list[str]:
    """Write the pictures of a run and its file for ParaView; their paths.

    Parameters
    ----------
    directory
        Is made where it is not there.
    frames
        Of which the first is at 0.
    half_width
        D of the box from −D to D, m.
    title
        What is seen, for the file for ParaView.
    """
    directory.mkdir(parents=True, exist_ok=True)
    run = evolution(frames)
    shown = panels(len(frames.times))
    filled = [slice(frames.particles[f]) for f in shown]

    def draw_panels(figure: "Figure") -> None:
        places, radii, temperatures = (
            [values[f, there] for f, there in zip(shown, filled, strict=True)]
            for values in (frames.positions, frames.radii, frames.temperatures)
        )
        draw_cloud(figure, frames.times[shown], places, radii, half_width, temperatures)

    pictures = (
        Picture(
            "cloud",
            f"The particles at {len(shown)} successive times.",
            draw_panels,
            cloud_size(len(shown)),
        ),
        Picture(
            "evolution",
            "The particles over time.",
            lambda figure: draw_evolution(figure, run),
            evolution_size(run),
        ),
    )
    for picture in pictures:
        write_picture(directory, picture)
    write_vtkhdf(directory / NAMES[-1], frames, title)
    return [str(directory / name) for name in NAMES]


def panels(frames: int) -> np.ndarray:
    """Return which of so many frames a picture shows: all, or some evenly from first to last."""
    return np.unique(np.rint(np.linspace(0, frames - 1, min(frames, PANELS))).astype(np.int64))
