import re

import pytest
from rich.console import Console

from agglom_mpi.display.fitted_table import FittedTable, LabelledTexts


def drawn(content, width):
    console = Console(width=width)
    with console.capture() as capture:
        console.print(content)
    return capture.get().splitlines()


@pytest.fixture
def table():
    table = FittedTable("variable", "searched", "5 %", "95 %", "", left=(0, 4))
    table.add_row("hardness Pa", "1e+07 to 2e+08", "1.4e+07", "1.85e+08", "decided")
    table.add_row("friction", "0.01 to 0.5", "0.0343", "0.478", "free")
    return table


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
    wanted = numbers.findall(" ".join(" ".join(row) for row in table.rows))
    assert max(map(len, lines)) <= width
    assert set(wanted) <= set(numbers.findall(" ".join(lines)))
    assert "…" not in "".join(lines)


def test_columns_without_cells_are_left_out_where_there_is_no_room():
    table = FittedTable("file", "samples", "re-estimate")
    table.add_row("a.h5", "12")
    assert drawn(table, 18) == ["file  samples", "a.h5       12"]
    assert drawn(table, 40)[0] == "file  samples  re-estimate"


def test_texts_stand_beside_their_labels_or_below():
    texts = LabelledTexts()
    texts.add_row("check", "the emulator is calibrated: 92.3 % of 699 strings")
    texts.add_row("expected error", "12.0 %")
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
