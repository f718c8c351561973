"""The papers' tables of best strings, and those of a campaign in the same layout."""

from collections.abc import Mapping, Sequence
from typing import Any, Final, NamedTuple

import numpy as np

from agglom_mpi.analysis.derived import values_of
from agglom_mpi.analysis.estimates import Estimate
from agglom_mpi.analysis.ranking import listed_strings, rank_strings
from agglom_mpi.analysis.tables import searched_variables
from agglom_mpi.formatting import number_or_none, value_with_error
from agglom_mpi.report.drawing import axis_label
from agglom_mpi.report.figures.figure import objective_label
from agglom_mpi.report.page_tables import PageTable
from agglom_mpi.report.shown_units import shown_unit
from agglom_mpi.storage.reader import CampaignData


class PublishedColumn(NamedTuple):
    """A column of a paper's table.

    Attributes
    ----------
    heading
    name
        A variable, `objective`, `mean_radius_ratio` or `growth_number`.
    unit
        SI value that the paper prints as 1.
    digits
        Format of a number.
    """

    heading: str
    name: str
    unit: float
    digits: str


class PublishedTable(NamedTuple):
    """A table of a paper, the best string first, in the units of its columns.

    Its CSV is `stem`.csv.
    """

    stem: str
    caption: str
    columns: tuple[PublishedColumn, ...]
    rows: tuple[tuple[float, ...], ...]


def _rows(text: str) -> tuple[tuple[float, ...], ...]:
    """Return the numbers of a table, a row per line."""
    return tuple(tuple(map(float, line.split())) for line in text.strip().splitlines())


ACCRETION: Final = (
    PublishedTable(
        "paper_A_table_1",
        "[A] table 1: best starting-state vectors after 22 generations",
        (
            PublishedColumn("v0 (m/s)", "relative_speed", 1.0, ".3f"),
            PublishedColumn("s", "size_ratio", 1.0, ".3f"),
            PublishedColumn("ρ (kg/m³)", "density", 1.0, ".3f"),
            PublishedColumn("H0 (MPa)", "hardness", 1e6, ".3f"),
            PublishedColumn("C (J/kg/K)", "heat_capacity", 1.0, ".3f"),
            PublishedColumn("μ0", "friction", 1.0, ".3f"),
            PublishedColumn("θ0 (K)", "temperature", 1.0, ".3f"),
            PublishedColumn("U (J/mol)", "activation_energy", 1.0, ".3f"),
            PublishedColumn("κ (J/m²)", "reaction_heat", 1.0, ",.3f"),
            PublishedColumn("Λ", "objective", 1.0, ".8f"),
        ),
        _rows("""
            4.326 0.633 6141.898 67.188 1279.542 0.307 330.652 707.351 5940883.989 0.00013602
            4.746 0.638 5579.604 60.730 1170.780 0.283 353.865 598.416 2347406.359 0.00036241
            4.434 0.637 5921.768 62.759 1310.642 0.292 349.057 578.921 3157762.434 0.00036671
            3.412 0.621 6436.049 76.611 1339.450 0.308 327.914 573.144 3864868.553 0.00039773
            3.074 0.626 5292.318 60.678 1114.462 0.311 335.793 751.632 6910186.063 0.00050522
            4.257 0.632 6124.641 62.269 1265.586 0.308 335.316 709.750 6790030.553 0.00070812
        """),
    ),
)
AGGLOMERATION: Final = (
    PublishedTable(
        "paper_B_table_1",
        "[B] table 1: best (normalised) starting-state vectors after 25 generations",
        (
            PublishedColumn("v0 (m/s) / 200", "relative_speed", 200.0, ".5f"),
            PublishedColumn("L", "size_ratio", 1.0, ".5f"),
            PublishedColumn("ρ (kg/m³) / 10⁴", "density", 1e4, ".5f"),
            PublishedColumn("H0 (Pa) / 10⁶", "hardness", 1e6, ".5f"),
            PublishedColumn("C (J/kg/K) / 2000", "heat_capacity", 2e3, ".5f"),
        ),
        _rows("""
            0.92344 0.79041 0.66527 0.26548 0.89815
            0.99307 0.79510 0.90509 0.49048 0.94075
            0.96042 0.79726 0.66773 0.39772 0.34235
            0.93911 0.79280 0.53228 0.20459 0.98942
            0.84977 0.79226 0.91791 0.15671 0.96995
            0.16761 0.79362 0.93962 0.10877 0.95669
        """),
    ),
    PublishedTable(
        "paper_B_table_2",
        "[B] table 2: best (normalised) starting-state vectors after 25 generations",
        (
            PublishedColumn("μ0 / 10⁻²", "friction", 1e-2, ".5f"),
            PublishedColumn("θ0 (K) / 10³", "temperature", 1e3, ".5f"),
            PublishedColumn("Ω (J/mol) / 10³", "activation_energy", 1e3, ".5f"),
            PublishedColumn("α (J/m²) / 10⁷", "reaction_heat", 1e7, ".5f"),
            PublishedColumn("γ (J/m²) / 10¹⁶", "surface_energy", 1e16, ".5f"),
        ),
        _rows("""
            0.13456 0.50218 0.35241 0.17765 0.83685
            0.17535 0.62494 0.12457 0.20836 0.85267
            0.11000 0.21911 0.19785 0.19901 0.93462
            0.15624 0.90323 0.38558 0.15209 0.91321
            0.10455 0.36270 0.32326 0.20403 0.80388
            0.15099 0.52338 0.29311 0.11186 0.25457
        """),
    ),
    PublishedTable(
        "paper_B_table_3",
        "[B] table 3: cost, size and particles of the agglomerates of tables 1 and 2",
        (
            PublishedColumn("Π", "objective", 1.0, ".5f"),
            PublishedColumn("b/b⁰", "mean_radius_ratio", 1.0, ".4f"),
            PublishedColumn("n^f = (b/b⁰)³", "growth_number", 1.0, ".4f"),
        ),
        _rows("""
            0.67708 3.2292 33.6732
            0.79078 2.0922 9.1581
            0.79636 2.0394 8.4821
            0.79957 2.0043 8.0517
            0.80036 1.9964 7.9568
            0.80691 1.9309 7.1991
        """),
    ),
)
PAPERS: Final[dict[str, tuple[dict[str, Any], tuple[PublishedTable, ...]]]] = {
    "[A] Accretion of fine grains (2003)": (
        {
            "objective.law": "growth_target",
            "objective.ratio": 2.0,
            "scene.particles": 100,
            "scene.duration.law": "mean_speed",
            "variables.relative_speed": (0.1, 30.0),
            "variables.size_ratio": (0.4, 0.8),
            "variables.density": (1e3, 1e4),
            "variables.hardness": (1e7, 2e8),
            "variables.heat_capacity": (10.0, 1500.0),
            "variables.friction": (0.01, 0.5),
            "variables.temperature": (273.13, 373.13),
            "variables.activation_energy": (10.0, 1000.0),
            "variables.reaction_heat": (0.0, 1e7),
        },
        ACCRETION,
    ),
    "[B] Agglomeration in thermochemically reacting flow (2004)": (
        {
            "objective.law": "maximum_growth",
            "scene.particles": 1000,
            "scene.duration.law": "compression_recovery",
            "variables.relative_speed": (20.0, 200.0),
            "variables.size_ratio": (0.4, 0.8),
            "variables.density": (1e3, 1e4),
            "variables.hardness": (1e5, 1e6),
            "variables.heat_capacity": (200.0, 2000.0),
            "variables.friction": (1e-3, 1e-2),
            "variables.temperature": (100.0, 1000.0),
            "variables.activation_energy": (100.0, 1000.0),
            "variables.reaction_heat": (1e6, 1e7),
            "variables.surface_energy": (1e15, 1e16),
        },
        AGGLOMERATION,
    ),
}
"""Each paper's scene, objective and search box, as entries of an identity, and its tables."""

RESULTS: Final = ("objective", "mean_radius_ratio", "growth_number")
"""Columns that are of samples."""
RE_ESTIMATE: Final = "re-estimate"
KINDS: Final = ("as searched", RE_ESTIMATE)
"""Marks of columns: of the samples that strings were chosen by, and of fresh samples."""


def matching_paper(identity: Mapping[str, Any]) -> str | None:
    """Return the paper with the scene, objective and search box of a campaign; None if neither."""
    for paper, (asked, _) in PAPERS.items():
        if all(_entry(identity, name, value) == value for name, value in asked.items()):
            return paper
    return None


def _entry(identity: Mapping[str, Any], name: str, value: Any) -> Any:
    if isinstance(value, tuple):
        return tuple(identity.get(f"{name}.{i}") for i in range(len(value)))
    return identity.get(name)


def comparison_tables(data: CampaignData) -> list[PageTable]:
    """Return the tables of the matching paper with a campaign's best strings between their rows.

    Without such a paper: one table of the best strings.
    """
    paper, best = matching_paper(data.identity), rank_strings(data).order[: listed_strings(data)]
    if paper is None:
        return [_own_table(data, best)]
    return [_beside(published, data, best) for published in PAPERS[paper][1]]


def _own_table(data: CampaignData, best: Sequence[int]) -> PageTable:
    objective, *results = AGGLOMERATION[2].columns
    columns = _by_kind(
        data,
        [
            *_variable_columns(data),
            objective._replace(heading=objective_label(data)),
            *results,
        ],
    )
    rows = [[str(i), *_cells(data, string, columns)] for i, string in enumerate(best, 1)]
    headings = ["rank", *(marked.heading for marked in columns)]
    return PageTable(headings, rows, "Best strings", name="best_strings_table")


def _variable_columns(data: CampaignData) -> list[PublishedColumn]:
    columns = []
    for variable, _, upper, _ in searched_variables(data):
        factor, unit = shown_unit(data, variable.name, variable.unit, upper)
        heading = axis_label(variable.name, unit)
        columns.append(PublishedColumn(heading, variable.name, factor, ".5g"))
    return columns


class MarkedColumn(NamedTuple):
    """A column, and whether it is of the samples of the search or of fresh ones."""

    column: PublishedColumn
    kind: str = ""

    @property
    def heading(self) -> str:
        """Heading of the column, with the kind of its samples."""
        return f"{self.column.heading}, {self.kind}" if self.kind else self.column.heading


def _by_kind(data: CampaignData, columns: Sequence[PublishedColumn]) -> list[MarkedColumn]:
    """Return columns with one of each kind in place of a result; of one kind if there is one."""
    kinds = KINDS if rank_strings(data).estimates else KINDS[:1]
    return [
        MarkedColumn(column, kind)
        for column in columns
        for kind in (kinds if column.name in RESULTS else ("",))
    ]


def _beside(published: PublishedTable, data: CampaignData, best: Sequence[int]) -> PageTable:
    columns = _by_kind(data, published.columns)
    rows: list[list[str]] = []
    classes: list[str] = []
    for place, printed in enumerate(published.rows):
        value = dict(zip(published.columns, printed, strict=True))
        cells = [
            "" if kind == RE_ESTIMATE else format(value[column], column.digits)
            for column, kind in columns
        ]
        rows.append([str(place + 1), "published", *cells])
        classes.append("published first")
        if place < len(best):
            rows.append([str(place + 1), "here", *_cells(data, best[place], columns)])
            classes.append("here")
    headings = ["rank", "from", *(marked.heading for marked in columns)]
    return PageTable(headings, rows, published.caption, classes, (1,), published.stem)


def _cells(data: CampaignData, string: int, columns: Sequence[MarkedColumn]) -> list[str]:
    """Return a row of a campaign's string; re-estimates are empty where it has none."""
    result = rank_strings(data).results[string]
    again = {estimate.string: estimate for estimate in rank_strings(data).estimates}.get(string)
    cells = []
    for column, kind in columns:
        source = again if kind == RE_ESTIMATE else result
        if not kind:
            value = float(values_of(data, [string], column.name)[0])
            cells.append(format(value / column.unit, column.digits))
        elif source is None:
            cells.append("")
        else:
            cells.append(_result(column, source))
    return cells


def _result(column: PublishedColumn, source: Estimate | np.void) -> str:
    """Return a result of a string by its re-estimate, or by its row of `/results`."""
    numbers = source._asdict() if isinstance(source, Estimate) else source
    if column.name == "objective":
        return value_with_error(float(numbers["objective"]), float(numbers["standard_error"]))
    ratio = float(numbers["mean_radius_ratio"])
    value = ratio if column.name == "mean_radius_ratio" else ratio**3
    return number_or_none(value / column.unit, column.digits)
