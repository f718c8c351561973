"""Tables of numbers as instruments write them are read where they have one meaning."""

import numpy as np
import pytest

from agglom_mpi.file_kinds import SHOWN_CHARACTERS, clipped, quoted_start
from agglom_mpi.measurements.files import size_table
from agglom_mpi.measurements.files.size_columns import SIZES
from agglom_mpi.measurements.files.size_table import GRAIN_EXAMPLE, read_diameters
from agglom_mpi.measurements.files.text_table import (
    Heading,
    TableError,
    parse_heading,
    read_table,
)


def table(text):
    content = text if isinstance(text, bytes) else text.encode()
    return read_table(content, SIZES, GRAIN_EXAMPLE)


@pytest.fixture
def read(tmp_path):
    """Return a function from the content of a file to its diameters in µm, or relative ones."""

    def diameters(content):
        (tmp_path / "s.csv").write_bytes(
            content if isinstance(content, bytes) else content.encode()
        )
        values, absolute = read_diameters(tmp_path, "s.csv")
        return absolute, [value * (1e6 if absolute else 1.0) for value in values]

    return diameters


LAYOUTS = {
    "brackets": "Diameter [um]\n40.5\n20.25\n",
    "parentheses": "diameter (um)\n40.5\n20.25\n",
    "a line of units": "Diameter;Area\num;um2\n40.5;1\n20.25;3\n",
    "units in brackets": "Diameter\t\n[µm]\n40.5\n20.25\n",
    "quotes": '"Diameter [um]"\n"40.5"\n"20.25"\n',
    "decimal commas": "Diameter [µm]\n40,5\n20,25\n",
    "commas and whole numbers": "Diameter [nm]\n40500\n20250,0\n",
    "quoted commas": 'ID,Diameter [um]\n1,"40,5"\n2,"20,25"\n',
    "semicolons": "ID;Diameter [µm];Form\n1;40,5;rund\n2;20,25;oval\n",
    "tabs": "ID\tDiameter (um)\tShape\n1\t40.5\tround\n2\t20.25\toval\n",
    "a column without a title": '\t"Diameter (um)" \n0\t40.5\n1\t"20.25" \n',
    "indented": "\tDiameter (um)\n\t40.5\n\t20.25\n",
    "commas": "ID,Diameter [um],Shape\n1,40.5,round\n2,20.25,oval\n",
    "spaces": "  ID   Diameter [um]  Area\n   1   40.5   3\n   2   20.25  4\n",
    "lines above": "Sample: 12\nDate;2024-01-05\n\nDiameter [um];Area\n40,5;12\n20,25;13\n",
    "a declared separator": "sep=;\nDiameter [mm];ID\n0,0405;1\n0,02025;7\n",
    "Latin-1": "Diameter [µm]\n40.5\n20.25\n".encode("latin-1"),
    "UTF-16": "Diameter [µm]\n40,5\n20,25\n".encode("utf-16"),
    "a byte-order mark": "\ufeffDiameter [um]\r\n40.5\r\n20.25\r\n",
    "old line ends": "Diameter [um]\r40.5\r20.25\r",
    "trailing separators": "Diameter [um];\n40.5;\n20.25;\n;;\n",
    "Fortran exponents": "diameter (um)\n4.05D+1\n2.025D1\n",
}


@pytest.mark.parametrize("content", LAYOUTS.values(), ids=LAYOUTS)
def test_a_table_with_one_meaning_is_read(read, content):
    absolute, values = read(content)
    assert absolute
    assert values == pytest.approx([40.5, 20.25], rel=1e-14)


def test_sizes_without_a_unit_are_relative(read):
    for content in ("40,5\n30\n", "diameter\n40.5\n30\n", "size (1);id\n40,5;1\n30;2\n"):
        assert read(content) == (False, [40.5, 30.0])


REFUSED = {
    "one column or two": ("40,5\n30,5\n", "line 1: '40,5' can be one number or two; write"),
    "one line of two numbers": ("diameter (um)\n40,50\n", "line 2: '40,50' can be one number or"),
    "a heading with a comma": ("Diameter, um\n40,5\n60,2\n", "line 2: '40,5' can be one number"),
    "a list in a line": ("diameter (um)\n40, 50\n", "line 2: has 2 fields"),
    "thousands": ("diameter (um)\n1,234\n2,345\n", "line 2: '1,234' is no number with one meani"),
    "both marks": ("diameter (um);a\n1.234,5;3\n", "line 2, column 'diameter': '1.234,5'"),
    "commas beside points": ("size (um);id\n4,5;1\n3;1.5\n", "column 'size': '4,5'"),
    "no headings": ("40.5 3\n30.5 4\n", "has 2 columns without headings; must have a heading"),
    "two columns of diameters": ("diameter;Size (um)\n3;5\n2;7\n", "'diameter', 'Size' (um)"),
    "another quantity": ("mass (kg)\n40\n", "line 1: 'mass (kg)' is neither a number nor a headi"),
    "half a diameter": ("half diameter (um)\n40\n", "line 1: 'half diameter (um)' is neither"),
    "a logarithm": ("log10 diameter (um)\n1.8\n", "line 1: 'log10 diameter (um)' is"),
    "another unit": ("diameter (kg)\n40\n", "the unit 'kg'; must be one of length like 'um'"),
    "two units": ("size (um)\nmm\n40\n", "line 2: 'mm'"),
    "shares in percent": ("size (um);q [%]\n2;50\n1;2\n", "column 'q' beside the sizes"),
    "counts": ("size (um);Count\n2;50\n1;2\n", "column 'Count' beside the sizes"),
    "classes": ("size (um);x\n1;2\n2;50\n4;8\n", "column 'x' beside the sizes"),
    "a sieve curve": ("Sieve (um);Passing (%)\n20;0\n32;12\n", "one grain per row"),
    "sieves alone": ("sieve (um)\n20\n32\n", "one grain per row"),
    "a last line of statistics": ("size (um);id\n2;1\nMean;2\n", "line 3, column 'size': 'Mean'"),
    "an empty field": ("size (um);id\n2;1\n;2\n", "line 3, column 'size': ''"),
    "a quotation mark": ('size (um)\n"40\n3\n', "line 2: quotation marks do not match"),
    "more fields than headings": ("size (um);id\n4;1;2\n", "line 2: has 3 fields; must have 2"),
    "a workbook": (b"PK\x03\x04\x14\x00", "is no text"),
    "bytes": (b"\x00\x01\x02\x80", "is no text"),
    "a long line": ("size (um)\n" + "4 " * 9000, "line 2: is longer than 10,000 characters"),
    "no rows": ("12;a\nsize (um);b\n", "has no rows below its headings"),
    "nothing": ("", "holds no number"),
}


@pytest.mark.parametrize(("content", "said"), REFUSED.values(), ids=REFUSED)
def test_another_table_is_refused_with_what_to_write(read, content, said):
    with pytest.raises(ValueError, match=r"^is 's\.csv': ") as caught:
        read(content)
    assert said in str(caught.value)


def test_as_many_sizes_as_are_allowed_are_read(read, monkeypatch):
    monkeypatch.setattr(size_table, "MAX_ROWS", 1000)
    _, values = read("diameter (um)\n" + "40\n60\n" * 500)
    assert len(values) == 1000
    for rows, said in ((1001, "has 1,001 rows; allowed: 1,000, so keep one in 2"), (9000, "in 10")):
        with pytest.raises(ValueError, match=said):
            read("diameter (um)\n" + "40\n" * rows)


PIECES = [*(bytes([byte]) for byte in b',;\t."\n\r#[]()1-e %_/\x00\xb5\xff'), b"um", b"sep="]


def test_any_bytes_are_a_table_or_refused_in_a_line(read):
    random = np.random.default_rng(1)
    layouts = [text if isinstance(text, bytes) else text.encode() for text in LAYOUTS.values()]
    for _ in range(10):
        for layout in layouts:
            content = bytearray(layout)
            for place in random.integers(len(layout) + 1, size=random.integers(1, 5)).tolist():
                content[place : place + random.integers(3)] = PIECES[random.integers(len(PIECES))]
            try:
                _, values = read(bytes(content))
                assert min(values) > 0.0
            except ValueError as error:
                assert str(error).startswith("is 's.csv': ")  # noqa: PT017
                assert str(error).isprintable()  # noqa: PT017


SECRET = "correct-horse-battery-staple"


@pytest.mark.parametrize(
    "content",
    [
        f"root:{SECRET}:19000:0:99999:7:::\n",
        f"password {SECRET}\n",
        f"{SECRET} 1 2\n3 4 5\n",
        f"diameter (um)\n{SECRET}\n40\n",
        f"diameter ({SECRET})\n40\n",
        f"diameter (um)\n40\n40;{SECRET}\n",
        f'{SECRET}\n"40\n1\n',
    ],
)
def test_a_message_quotes_no_more_than_the_start_of_a_field(read, content):
    with pytest.raises(ValueError, match=r"^is 's\.csv': ") as caught:
        read(content)
    assert SECRET[:SHOWN_CHARACTERS] not in str(caught.value)


def test_a_file_without_a_number_is_not_quoted(read):
    with pytest.raises(ValueError, match=r"^is 's\.csv': holds no number$"):
        read(f"{SECRET}\nroot:x:0:0\n")


def test_what_is_quoted_can_be_printed():
    assert quoted_start("a\x1b[31m\nb\u202e" + "c" * 30) == "'a[31mb" + "c" * 11 + "...'"
    assert quoted_start("Diameter") == "'Diameter'"
    assert clipped(f"unknown encoding: {SECRET}") == "unknown encoding: correct-horse-bat..."


@pytest.mark.parametrize(
    ("text", "heading"),
    [
        ("Diameter [um]", Heading("Diameter", "um")),
        ("Passing (%) by mass", Heading("Passing by mass", "%")),
        ("Percent passing by mass", Heading("passing by mass", "%")),
        ("% finer", Heading("finer", "%")),
        ("time / ms", Heading("time / ms")),
        ("Diameter min", Heading("Diameter min")),
    ],
)
def test_a_heading_has_a_title_and_a_unit(text, heading):
    assert parse_heading(text) == heading


def test_a_table_gives_numbers_by_column_with_their_lines():
    found = table("# a comment\nsize (um);q\n\n4,5;0,125\n3;1\n")
    assert found.lines == [4, 5]
    assert found.numbers(0) == [4.5, 3.0]
    assert found.numbers(1) == [0.125, 1.0]
    assert found.place(1, 1) == "line 5, column 'q'"


def test_another_title_is_no_heading():
    with pytest.raises(TableError, match="line 1: 'Radius' is neither a number nor a heading"):
        table("Radius\n3\n")
