"""Every type of figure once, at print width, and all of them on one sheet for a review by eye.

Run it as `python tests/helpers/contact_sheet.py FILE.h5... --out SHEET.png`: a figure is drawn from
the first file that has its data.
"""

import argparse
import tempfile
from collections.abc import Iterator, Sequence
from contextlib import suppress
from pathlib import Path

import agglom_mpi
from agglom_mpi.accuracy.maps.laws import ImpactPlane, law_section
from agglom_mpi.accuracy.maps.scene import map_scene
from agglom_mpi.inference.data_posterior import data_posterior
from agglom_mpi.inference.feasible_set import NoFeasibleSetError, feasible_set
from agglom_mpi.inference.posterior import PosteriorError
from agglom_mpi.report.figures.evolution import draw_evolution, evolution, evolution_size
from agglom_mpi.report.figures.figure import FigureOptions, figures
from agglom_mpi.report.style import PAGE, Drawing, write_drawing
from agglom_mpi.search.criteria import NoCriterionError
from agglom_mpi.storage.reader import CampaignData, read_campaign

JOBS = Path(__file__).parents[2] / "jobs"
COLUMNS = 4
WIDTH = 460
"""Width of a figure on the sheet in pixels, if it is as wide as a page."""


def options_of(data: CampaignData) -> FigureOptions:
    """Return the set and the posterior of a file, where it has them."""
    options = FigureOptions(sensitivity=True, plotted=True)
    with suppress(NoFeasibleSetError, NoCriterionError):
        options = options._replace(feasible_set=feasible_set(data))
    with suppress(PosteriorError):
        options = options._replace(posterior=data_posterior(data))
    return options


def drawings_of(files: Sequence[Path], left_out: Sequence[str] = ()) -> Iterator[Drawing]:
    """Yield each figure of campaigns once, of the first file that has it, and others."""
    missing = [name for name in figures() if name not in left_out]
    for file in files:
        data = read_campaign(file, allow_code=True)
        options = options_of(data)
        for name in list(missing):
            drawing = figures()[name].drawing(data, options)
            if drawing is not None:
                missing.remove(name)
                yield drawing
    campaign = agglom_mpi.load_campaign(JOBS / "quickstart.yaml")
    strings = {"relative_speed": 17.5, "hardness": 1.4e8}
    run = evolution(campaign.simulate(strings, frames=40).frames)
    yield Drawing("evolution", "", lambda figure: draw_evolution(figure, run), evolution_size(run))
    row = agglom_mpi.load_campaign(JOBS / "accuracy" / "accretion_2003_row_1.yaml")
    yield from law_section(ImpactPlane(map_scene(row, {}, 100, 1000)), quick=True).figures


def write_sheet(drawings: Iterator[Drawing], path: Path) -> list[str]:
    """Write all drawings onto one sheet, each to the same scale, and return their names."""
    from PIL import Image

    with tempfile.TemporaryDirectory() as folder:
        pictures, names = [], []
        for drawing in drawings:
            write_drawing(Path(folder), drawing)
            names.append(drawing.name)
            with Image.open(Path(folder) / f"{drawing.name}.png") as opened:
                scale = WIDTH / PAGE * drawing.size[0] / opened.width
                size = round(scale * opened.width), round(scale * opened.height)
                pictures.append(opened.convert("RGB").resize(size, Image.Resampling.LANCZOS))
    pictures.sort(key=lambda picture: picture.height)
    rows = [pictures[first : first + COLUMNS] for first in range(0, len(pictures), COLUMNS)]
    heights = [max(picture.height for picture in row) for row in rows]
    sheet = Image.new("RGB", (COLUMNS * WIDTH, sum(heights)), "white")
    for place, row in enumerate(rows):
        for column, picture in enumerate(row):
            sheet.paste(picture, (column * WIDTH, sum(heights[:place])))
    few = sheet.quantize(256, Image.Quantize.MAXCOVERAGE, dither=Image.Dither.NONE)
    few.save(path, optimize=True)
    return names


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("files", nargs="+", type=Path)
    parser.add_argument("--out", type=Path, default=JOBS / "pictures" / "contact_sheet.png")
    parser.add_argument("--without", action="append", default=[], help="figure to leave out")
    given = parser.parse_args()
    print(", ".join(write_sheet(drawings_of(given.files, given.without), given.out)))
