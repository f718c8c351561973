import math
import re

import pytest
from rich.console import Console

from agglom_mpi.display.table import Column, Facts, Table


def drawn(content, width):
    console = Console(width=width)
    with console.capture() as capture:
        console.print(content)
    return capture.get().splitlines()


@pytest.fixture
def table():
    columns = [Column("variable"), Column("searched"), Column("low", "5 %", format=".4g")]
    columns += [Column("high", "95 %", format=".4g"), Column("kind", "", text=True)]
    rows = [
        ("hardness Pa", "1e+07 to 2e+08", 1.4e7, 1.85e8, "decided"),
        ("friction", "0.01 to 0.5", 0.0343, 0.478, "free"),
    ]
    keys = [column.key for column in columns]
    return Table(columns, [dict(zip(keys, row, strict=True)) for row in rows])


def test_a_wide_terminal_gets_one_table(table):
    assert drawn(table, 80) == [
        "variable           searched      5 %      95 %",
        "hardness Pa  1e+07 to 2e+08  1.4e+07  1.85e+08  decided",
        "friction        0.01 to 0.5   0.0343     0.478  free",
    ]


def test_what_has_no_room_beside_follows_below(table):
    assert drawn(table, 40) == [
        "variable           searched      5 %",
        "hardness Pa  1e+07 to 2e+08  1.4e+07",
        "friction        0.01 to 0.5   0.0343",
        "",
        "variable         95 %",
        "hardness Pa  1.85e+08  decided",
        "friction        0.478  free",
    ]


def test_where_nothing_fits_beside_the_labels_rows_are_paragraphs(table):
    lines = drawn(table, 26)
    assert lines[:4] == [
        "variable",
        "hardness Pa",
        "  searched  1e+07 to 2e+08",
        "  5 %       1.4e+07",
    ]


@pytest.mark.parametrize("width", range(12, 90, 3))
def test_no_number_is_cut_at_any_width(table, width):
    numbers = re.compile(r"[\d.]+(?:e\+\d+)?")
    lines = drawn(table, width)
    wanted = numbers.findall(" ".join(" ".join(row) for row in table.cells))
    assert max(map(len, lines)) <= width
    assert set(wanted) <= set(numbers.findall(" ".join(lines)))
    assert "…" not in "".join(lines)


def test_columns_without_cells_are_left_out():
    columns = [Column("file"), Column("samples", format="d"), Column("re-estimate")]
    table = Table(columns, [{"file": "a.h5", "samples": 12}])
    assert drawn(table, 40) == ["file  samples", "a.h5       12"]


def test_rows_of_an_upright_table_are_columns_of_the_terminal():
    columns = [Column("rank"), Column("hardness", unit="MPa", format=".3g", size=1e6)]
    rows = [{"rank": "#1", "hardness": 6.7e7}, {"rank": "#2", "hardness": 1e8}]
    lines = drawn(Table(columns, rows, upright=True), 40)
    assert lines == ["rank            #1   #2", "hardness (MPa)  67  100"]


def test_the_terminal_shows_a_constant_value_once():
    columns = [Column("rank"), Column("friction", constant=True), Column("samples")]
    rows = [{"rank": f"#{i}", "friction": "0.3", "samples": f"{i}0"} for i in (1, 2)]
    table = Table(columns, rows, upright=True)
    assert drawn(table, 40) == ["rank       #1  #2", "friction  0.3", "samples    10  20"]
    assert drawn(table, 13)[-3:] == ["", "rank      #2", "samples   20"]
    assert table.csv().splitlines()[2] == "#2,0.3,20"


def test_where_an_upright_table_does_not_fit_each_row_is_a_paragraph():
    columns = [Column("rank"), Column("activation energy", unit="J/mol"), Column("samples")]
    rows = [{"rank": "#1", "activation energy": "67.25 ± 0.50", "samples": "9"}, {"rank": "#2"}]
    assert drawn(Table(columns, rows, upright=True), 32) == [
        "rank",
        "#1",
        "  activation energy (J/mol)",
        "    67.25 ± 0.50",
        "  samples                    9",
        "#2",
    ]


def test_numbers_are_shown_in_the_unit_and_format_of_their_column():
    column = Column("length", unit="mm", format=".3g", size=1e-3)
    assert column.heading == "length (mm)"
    values = [0.0015, math.nan, None, "long", (0.02, 0.001)]
    cells = [column.cell({"length": value}) for value in values]
    assert cells == ["1.5", "none", "", "long", "20.0 ± 1.0"]


def test_a_table_in_markdown_and_csv_has_the_texts_that_are_shown():
    columns = [Column("name", text=True), Column("share", format=".0%")]
    table = Table(columns, [{"name": "=a|b", "share": 0.5}])
    assert table.markdown().splitlines() == ["| name | share |", "| --- | ---: |", "| =a¦b | 50% |"]
    assert table.csv().splitlines() == ["name,share", "'=a|b,50%"]


def test_texts_stand_beside_their_labels_or_below():
    check = ("check", "the emulator is calibrated: 92.3 % of 699 strings")
    texts = Facts([check, ("expected error", "12.0 %")])
    assert drawn(texts, 80)[1] == "expected error  12.0 %"
    assert drawn(texts, 50)[:2] == [
        "check           the emulator is calibrated: 92.3 %",
        "                of 699 strings",
    ]
    assert drawn(texts, 30) == [
        "check",
        "    the emulator is",
        "    calibrated: 92.3 % of 699",
        "    strings",
        "expected error",
        "    12.0 %",
    ]
