"""Files of measured sizes as instruments and laboratories write them, and what is refused."""

from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
import pytest
from examples import examples
from hypothesis import strategies as st

from agglom_mpi.declaration.declared import FieldError
from agglom_mpi.measurements.files.curve_file import read_size_curve
from agglom_mpi.measurements.files.size_columns import CurveKeys

ERROR = CurveKeys(error=0.02)
COUNTED = CurveKeys(counted=1000)
EDGES = [63e-6, 125e-6, 250e-6, 500e-6]
SHARES = [0.1, 0.25, 0.5, 0.15]
"""Shares below 63 µm, of the two classes, and from 250 to 500 µm."""


@pytest.fixture
def read(tmp_path):
    """Return a function from the content of a file to its curve."""
    return lambda content, keys=ERROR: read_in(tmp_path, content, keys)


def read_in(folder, content, keys=ERROR):
    binary = content if isinstance(content, bytes) else content.encode()
    (folder / "s.csv").write_bytes(binary)
    return read_size_curve(folder, "s.csv", keys)


LAYOUTS = {
    "Mastersizer, size classes": (
        "Mastersizer 2000\tVer. 5.60\nSample Name:\tSand\n\n"
        "Size (µm)\tVolume In (%)\n10.000\t0.00\n20.000\t10.00\n63.000\t25.00\n125.000\t50.00\n"
        "250.000\t15.00\n500.000\t0.00\n1000.000\t\n",
        {"headings": {"Volume In (%)": "volume share (%)"}},
    ),
    "Mastersizer, cumulative": (
        "Size (μm),Volume Under (%)\n20.0,0.00\n63.0,10.00\n125.0,35.00\n250.0,85.00\n"
        "500.0,100.00\n1000.0,100.00\n",
        {"headings": {"Volume Under (%)": "volume passing (%)"}},
    ),
    "sieve sheet with a pan": (
        "Lab;Sieve test 4\n\nSieve size (mm);Mass retained (g)\n0.5;0\n0.25;30.0\n0.125;100.0\n"
        "0.063;50.0\nPan;20.0\nTotal;200.0\n",
        {},
    ),
    "ASTM sheet": (
        "Sieve No.,Sieve size (mm),Retained (g),Retained (%),Cumulative retained (%),"
        "Passing (%)\n35,0.5,0,0,0,100\n60,0.25,30,15,15,85\n120,0.125,100,50,65,35\n"
        "230,0.063,50,25,90,10\n",
        {"column": "Passing"},
    ),
    "amounts in words": (
        "Aperture (mm),Percent passing by mass\n0.5,100\n0.25,85\n0.125,35\n0.063,10\n",
        {},
    ),
    "Camsizer": (
        "CAMSIZER 0.3.5.7\r\nDate\t12.3.2014\r\n\r\nx1 [mm]\tx2 [mm]\tp3 [%]\tQ3 [%]\tSPHT3\r\n"
        "0.000\t0.063\t10.0\t10.0\t0.8\r\n0.063\t0.125\t25.0\t35.0\t0.81\r\n"
        "0.125\t0.250\t50.0\t85.0\t0.82\r\n0.250\t0.500\t15.0\t100.0\t0.83\r\n",
        {"headings": {"x1 [mm]": "lower", "x2 [mm]": "upper", "p3 [%]": "share"}, "column": "p3"},
    ),
    "decimal commas": (
        "Sieve [mm];Retained [g];Passing [%]\r\n0,5;0,0;100,0\r\n0,25;30,0;85,0\r\n"
        "0,125;100,0;35,0\r\n0,063;50,0;10,0\r\nPan;20,0;0,0\r\n".encode("cp1252"),
        {"column": "passing (%)"},
    ),
    "classes with a byte-order mark": (
        "\ufeffClass [µm];Mass share [%]\r\n<63;10,0\r\n63-125;25,0\r\n125-250;50,0\r\n"
        "250-500;15,0\r\n",
        {},
    ),
    "Helos": (
        "xo/µm;Q3/%;xm/µm;q3lg\n63,00;10,00;44,5;0,2\n125,00;35,00;88,7;0,84\n"
        "250,00;85,00;176,8;1,66\n500,00;100,00;353,6;0,5\n",
        {"headings": {"xo/µm": "size (um)", "Q3/%": "passing (%)"}},
    ),
    "lower and upper edges, fractions": (
        "lower (um),upper (um),share\n0,63,0.1\n63,125,0.25\n125,250,0.5\n250,500,0.15\n",
        {},
    ),
    "oversize, UTF-16": (
        "Particle size (µm)\tCumulative retained (%)\n63\t90\n125\t65\n250\t15\n500\t0\n".encode(
            "utf-16"
        ),
        {},
    ),
    "a line of units": (
        "Sieve;Passing\nmm;%\n0.5;100\n0.25;85\n0.125;35\n0.063;10\n",
        {},
    ),
    "masses and percentages": (
        "Sieve (mm);Retained (g);Retained (%)\n0,5;0,0;0\n0,25;30,0;15\n"
        "0,125;100,0;50\n0,063;50,0;25\nPan;20,0;10\nTotal;200,0;100\n",
        {"column": "Retained (g)"},
    ),
    "upper edges": ("Upper (um);Volume (%)\n63;10\n125;25\n250;50\n500;15\n", {}),
}


@pytest.mark.parametrize(("content", "keys"), LAYOUTS.values(), ids=LAYOUTS)
def test_a_layout_of_an_instrument_is_read(read, content, keys):
    curve = read(content, CurveKeys(error=0.02, **keys))
    assert curve.shares == pytest.approx(SHARES, abs=1e-12)
    assert curve.edges[1:] == pytest.approx(EDGES, rel=1e-12)
    assert curve.edges[0] in (0.0, pytest.approx(20e-6))
    assert curve.weight == "mass"


@pytest.mark.parametrize("headings", ["lower (um);upper", "lower;upper (um)"])
def test_one_unit_is_that_of_both_edges(read, headings):
    curve = read(f"{headings};share (%)\n10;63;20\n63;125;80\n")
    assert curve.edges == pytest.approx([10e-6, 63e-6, 125e-6])


def test_an_error_column_is_that_of_each_row(read):
    text = "Sieve (mm);Passing (%);Error (%)\n0.5;100;0\n0.25;85;1\n0.125;35;2\n0.063;10;0.5\n"
    curve = read(text, CurveKeys())
    assert curve.errors_of == "passing"
    assert curve.errors == pytest.approx((0.005, 0.02, 0.01))
    variances = np.array([0.0, 0.005, 0.02, 0.01, 0.0]) ** 2
    covariance = curve.covariance
    assert np.diag(covariance) == pytest.approx(variances[1:] + variances[:-1])
    assert np.diag(covariance, 1) == pytest.approx(-variances[1:-1])
    assert covariance.sum() == pytest.approx(0.0, abs=1e-18)


def test_errors_of_amounts_are_those_of_their_shares(read):
    text = "class (um);mass (g);error (g)\n0-63;20;2\n63-125;50;3\n125-250;130;4\n"
    curve = read(text, CurveKeys())
    random = np.random.default_rng(1)
    amounts = np.array([20, 50, 130]) + 1e-3 * random.normal(size=(20_000, 3)) * [2, 3, 4]
    shares = amounts / amounts.sum(axis=1, keepdims=True)
    assert np.cov(shares.T) * 1e6 == pytest.approx(curve.covariance, rel=0.06, abs=3e-6)


def test_counts_are_multinomial(read):
    curve = read("lower (um);upper (um);Count\n10;20;30\n20;40;60\n40;80;110\n", CurveKeys())
    shares = np.array([30, 60, 110]) / 200
    assert curve.weight == "number"
    assert curve.covariance == pytest.approx(
        (np.diag(shares) - np.outer(shares, shares)) / 200, abs=1e-15
    )


def test_counted_grains_that_are_weighed_vary_as_they_were_drawn(read):
    sizes, number = np.array([15.0, 30.0, 60.0]), np.array([0.6, 0.3, 0.1])
    masses = number * sizes**3
    shares = masses / masses.sum()
    rows = "".join(
        f"{s / 2**0.5};{s * 2**0.5};{share}\n" for s, share in zip(sizes, shares, strict=True)
    )
    curve = read("lower (um);upper (um);mass share\n" + rows, COUNTED)
    drawn = np.random.default_rng(2).multinomial(1000, number, size=20_000) * sizes**3
    found = drawn / drawn.sum(axis=1, keepdims=True)
    assert np.cov(found.T) == pytest.approx(curve.covariance, rel=0.06, abs=1e-6)


@pytest.mark.parametrize(("weight", "power"), [("number", 0), ("area", 2), ("mass", 3)])
def test_a_list_of_grains_counts_itself(read, weight, power):
    random = np.random.default_rng(3)
    drawn = np.exp(0.3 * random.normal(size=(400, 500)))
    curve = read("Diameter (um)\n" + "\n".join(map(str, drawn[0])), CurveKeys(weight))
    assert min(curve.shares) >= 0.05
    assert sum(curve.shares) == pytest.approx(1.0)
    edges = np.array(curve.edges) * 1e6
    weighed = drawn**power
    cumulative = [(weighed * (drawn < edge)).sum(1) / weighed.sum(1) for edge in edges[1:-1]]
    spread = np.std(np.diff(np.array(cumulative), axis=0), axis=1)
    own = np.sqrt(np.diag(curve.covariance))[1:-1]
    # A standard deviation of 400 has an error of 1/28; that of the 500 grains' own is larger.
    assert own == pytest.approx(spread, rel=0.35)
    assert own.mean() == pytest.approx(spread.mean(), rel=0.1)


IMAGEJ = " ,Area,Mean,Min,Max,Circ.,Feret,MinFeret\n" + "".join(
    f"{i + 1},{3.14159265 / 4 * d * d:.6f},80,1,255,0.9,{1.1 * d},{0.9 * d}\n"
    for i, d in enumerate(np.linspace(10, 30, 40))
)


def test_results_of_imagej_need_a_column_and_a_unit(read):
    feret = {"headings": {"Feret": "diameter"}}
    by_area = read(IMAGEJ, CurveKeys("number", "Area", "um^2"))
    by_feret = read(IMAGEJ, CurveKeys("number", "Feret", "um", **feret))
    assert by_feret.edges[1:-1] == pytest.approx(1.1 * np.array(by_area.edges[1:-1]), rel=1e-5)
    for keys in (CurveKeys("number", unit="um", **feret), CurveKeys("number", "Feret", **feret)):
        with pytest.raises(ValueError, match=r"beside the sizes|'Feret'"):
            read(IMAGEJ, keys)


def test_what_a_heading_states_of_the_weight_is_kept(read):
    text = "size [um];number passing [%];mass passing [%]\n10;20;5\n20;60;30\n40;100;100\n"
    assert read(text, CurveKeys("number", error=0.01)).shares[0] == pytest.approx(0.2)
    assert read(text, CurveKeys("mass", error=0.01)).shares[0] == pytest.approx(0.05)
    with pytest.raises(FieldError, match=r"column.*'number passing'"):
        read(text)
    with pytest.raises(FieldError, match="weight"):
        read(text, CurveKeys("area", "mass passing", error=0.01))


REFUSED = {
    "a curve that turns back": (
        "Sieve (mm);Passing (%)\n0.5;100\n0.25;35\n0.125;85\n0.063;10\n",
        ("line 3", "'Passing'", "'35'"),
    ),
    "a sum of 70 %": ("class (um);share (%)\n0-63;20\n63-125;50\n", ("'share'", "70", "100 %")),
    "no unit of amounts": ("sieve (um);passing\n63;20\n125;70\n", ("'passing'", "%")),
    "a negative share": (
        "class (um);share (%)\n0-63;-20\n63-125;120\n",
        ("line 2", "'share'", "'-20'"),
    ),
    "edges or middles": ("size (um);share (%)\n63;20\n125;80\n", ("'size'", "lower", "upper")),
    "an empty file": ("", ("no number",)),
    "an HDF5 file": (b"\x89HDF\r\n\x1a\n" + bytes(100), ("HDF5",)),
    "bytes": (bytes(range(256)), ("text",)),
    "a workbook": (b"PK\x03\x04\x14\x00", ("CSV",)),
    "an error of 0": (
        "sieve (um);passing (%);error (%)\n63;20;0\n125;100;0\n",
        ("line 2", "'error'", "'0'"),
    ),
    "a text among numbers": (
        "sieve (um);passing (%)\n63;20\n90;n/a\n125;100\n",
        ("line 3", "'passing'", "'n/a'"),
    ),
    "a sieve twice": (
        "sieve (um);passing (%)\n63;20\n90;50\n90;60\n125;100\n",
        ("line 4", "'sieve'", "'90'", "line 3"),
    ),
    "sizes in no order": (
        "sieve (um);passing (%)\n63;20\n900;50\n125;60\n250;100\n",
        ("line 4", "'125'"),
    ),
    "a gap between classes": (
        "class (um);share (%)\n0-63;20\n125-250;80\n",
        ("line 3", "'125-250'", "line 2"),
    ),
    "more than 100 %": ("sieve (um);passing (%)\n63;20\n125;120\n", ("line 3", "'120'", "100")),
    "no pan": ("sieve (um);retained (g)\n250;20\n125;50\n", ("pan",)),
    "a pan that is not empty below": (
        "sieve (um);passing (%)\n125;100\n63;20\npan;20\n",
        ("line 4", "'20'"),
    ),
    "one class": ("class (um);share (%)\n63-125;100\n", ("classes", "two")),
    "an open class alone": ("class (um);passing (%)\n>63;100\n", ("two sizes",)),
    "by intensity": ("size (nm);intensity (%)\n10;20\n20;80\n", ("'intensity'",)),
    "a density": (
        "size (um);Volume (1/um)\n10;2\n20;8\n30;9\n",
        ("'Volume'", "amount of each size"),
    ),
    "an amount without a name": ("size (um);y\n10;2\n20;8\n30;5\n", ("'y'",)),
    "a class in a class": ("class (um);share (%)\n0-63;20\n63;30\n63-125;50\n", ("line 3", "'63'")),
    "a pan below 0": ("class (um);share (%)\npan;20\n0-63;80\n", ("line 2", "'pan'")),
    "a pan of upper edges": ("upper (um);share (%)\npan;20\n63;80\n", ("line 2", "'pan'")),
    "an edge alone": ("lower (um),share (%),id\n63,,1\n", ("two sizes",)),
    "no sizes": ("mass (g);passing (%)\n63;20\n125;100\n", ("line 1", "heading")),
    "a curve over middles": (
        "middle (um);passing (%)\n63;20\n125;100\n",
        ("line 1", "heading"),
    ),
    "no headings": ("63;20\n125;100\n", ("heading",)),
    "no grains": ("class (um);mass (g)\n0-63;0\n63-125;0\n", ("'mass'", "0")),
    "a negative size": ("sieve (um);passing (%)\n-63;20\n125;100\n", ("line 2", "'-63'")),
}


@pytest.mark.parametrize(("content", "named"), REFUSED.values(), ids=REFUSED)
def test_another_file_is_refused_with_its_line_and_value(read, content, named):
    keys = CurveKeys() if "error" in str(content) else ERROR
    with pytest.raises(ValueError, match=r"^is 's\.csv'") as caught:
        read(content, keys)
    for part in named:
        assert part in str(caught.value)
    assert str(caught.value).isprintable()


KEYS = {
    "no error": (CurveKeys(), "sieve (um);mass passing (%)", "error"),
    "two errors": (CurveKeys(error=0.1, counted=3), "sieve (um);passing (%)", "counted"),
    "an error and a column": (ERROR, "sieve (um);passing (%);error (%)", "error"),
    "two columns of errors": (CurveKeys(), "sieve (um);passing (%);error;Error", "error"),
    "two units": (CurveKeys(error=0.1, unit="mm"), "sieve (um);passing (%)", "unit"),
    "no unit": (ERROR, "sieve;passing (%)", "unit"),
    "another unit": (ERROR, "sieve (kg);passing (%)", "unit"),
    "another unit of the entry": (CurveKeys(error=0.1, unit="kg"), "sieve;passing (%)", "unit"),
    "another column": (CurveKeys(error=0.1, column="Retained"), "size (um);passing (%)", "column"),
    "one heading twice": (ERROR, "sieve (um);passing (%);Passing (%)", "column"),
    "another weight": (CurveKeys("number", error=0.1), "size (um);mass passing (%)", "weight"),
}


@pytest.mark.parametrize(("keys", "headings", "field"), KEYS.values(), ids=KEYS)
def test_a_key_that_does_not_fit_the_file_is_named(read, keys, headings, field):
    rows = [f"{size};{share};{share};1\n" for size, share in ((63, 20), (125, 70), (250, 100))]
    width = headings.count(";") + 1
    text = "".join(";".join(row.split(";")[:width]).strip() + "\n" for row in rows)
    with pytest.raises(FieldError) as caught:
        read(f"{headings}\n{text}", keys)
    [((name,), _)] = caught.value.problems
    assert name == field


def test_a_list_of_grains_takes_no_error(read):
    grains = "diameter (um)\n" + "".join(f"{10 + i}\n" for i in range(50))
    for keys, field in ((ERROR, "error"), (COUNTED, "counted")):
        with pytest.raises(FieldError, match=field):
            read(grains, keys)


IN_FOUR = "10;20;14\n20;40;57\n40;80;21\n80;160;8\n"
UNKNOWN = {
    "fractions of an inch": ("Sieve (in);Passing (%)\n1/2;50\n3/4;100\n", "1/2"),
    "logarithms": ("log10 diameter (um);Passing (%)\n1.8;10\n2.7;100\n", "log10 diameter"),
    "radii": ("half diameter (um);Passing (%)\n10;50\n20;100\n", "half diameter"),
    **{
        heading: (f"lower (um);upper (um);{heading}\n{IN_FOUR}", "has no column of amounts")
        for heading in (
            *("number/cm3", "number density", "number per cm3", "counts/s", "number (1/cm3)"),
            *("q3 (%/um)", "q3 (%)", "dV/dlogD (%)", "mass density (% per um)", "mass (%/um)"),
            *("Q3 density (%)", "moisture (%)", "relative error (%)", "volume/diameter (%)"),
        )
    },
    "a list beside an unknown amount": (
        "diameter (um);number/cm3;id\n10;3;1\n20;5;2\n30;4;3\n",
        "number/cm3",
    ),
    "an error of 100 %": ("sieve (um);passing (%);error (%)\n63;20;100\n125;100;0\n", "'100'"),
    **{
        f"{heading} of {number}": (
            f"{heading}\n{row.format(number)}\n125;20;2\n250;100;3\n",
            number,
        )
        for number in ("1e308", "1e-320", "1e200", "1e-200")
        for heading, row in {
            "sieve (um);passing (%);error (%)": "63;10;{}",
            "sieve (um);passing (%);sd (%)": "{};10;1",
            "lower (um);count;id": "63;{};1",
            "lower (um);mass (g);id": "63;{};1",
        }.items()
    },
}


@pytest.mark.parametrize(("content", "named"), UNKNOWN.values(), ids=UNKNOWN)
def test_what_is_not_known_with_certainty_is_refused(read, content, named):
    keys = CurveKeys() if "error" in content else ERROR
    with pytest.raises(ValueError, match=r"^is 's\.csv'") as caught:
        read(content, keys)
    assert named in str(caught.value)


@pytest.mark.parametrize("number", ["1e200", "1e-200"])
def test_a_list_with_an_extreme_diameter_is_refused(read, number):
    with pytest.raises(ValueError, match=f"line 2: '{number}'"):
        read(f"diameter (um)\n{number}\n" + "40\n50\n" * 10, CurveKeys("number"))


def test_one_of_several_columns_of_amounts_is_named(read):
    text = "Sieve (mm);Retained (g);Retained (%);Passing (%)\n" + "".join(
        f"{row}\n" for row in ("0.5;0;0;100", "0.25;30;15;85", "0.125;100;50;35", "0.063;70;35;10")
    )
    for column in ("", "Retained"):
        with pytest.raises(FieldError) as caught:
            read(text, CurveKeys(error=0.02, column=column))
        assert [path for path, _ in caught.value.problems] == [("column",)]
    for column in ("Passing", "passing (%)"):
        curve = read(text, CurveKeys(error=0.02, column=column))
        assert curve.shares == pytest.approx(SHARES, abs=1e-12)


def test_an_entry_may_say_what_headings_mean(read):
    text = "Lab;4\nKorn;Weg (Lab)\n0.5;100\n0.25;85\n0.125;35\n0.063;10\n"
    keys = CurveKeys(error=0.02, headings={"Korn": "size (mm)", "Weg (Lab)": "passing (%)"})
    curve = read(text, keys)
    assert curve.shares == pytest.approx(SHARES, abs=1e-12)
    assert curve.edges[1:] == pytest.approx(EDGES, rel=1e-12)
    for wrong in ({"Weg": "passing (%)"}, {"Korn": "length (mm)"}):
        with pytest.raises(FieldError, match="headings"):
            read(text, keys._replace(headings=keys.headings | wrong))


def test_sizes_in_order_are_grains_if_their_column_is_named(read):
    text = "diameter (um);id\n" + "".join(f"{10 + i};{i}\n" for i in range(50))
    with pytest.raises(ValueError, match="'id'"):
        read(text, CurveKeys("number"))
    assert sum(read(text, CurveKeys("number", "diameter")).shares) == pytest.approx(1.0)


def numbers_as(text, comma):
    return text.replace(".", ",") if comma else text


CURVES = ["passing", "cumulative retained"]


@st.composite
def tables(draw):
    """Shares of classes, and a file of them in some layout."""
    count = draw(st.integers(2, 12))
    steps = draw(st.lists(st.integers(11, 40), min_size=count + 1, max_size=count + 1))
    edges = 0.7 * np.cumprod(np.array(steps) / 10.0)
    parts = np.array(draw(st.lists(st.integers(1, 1000), min_size=count, max_size=count)))
    shares = parts / parts.sum()
    unit, size = draw(st.sampled_from([("um", 1e-6), ("mm", 1e-3), ("nm", 1e-9), ("µm", 1e-6)]))
    separator = draw(st.sampled_from([";", "\t", ","]))
    comma = separator != "," and draw(st.booleans())
    form = draw(st.sampled_from([*CURVES, "classes", "edges", "staggered"]))
    percent = draw(st.booleans())
    factor, sign = (100.0, "%") if percent else (1.0, "1")
    values, rows = shares * factor, []
    titles = [f"size ({unit})", f"share ({sign})"]
    if form in CURVES:
        below = np.concatenate([[0.0], np.cumsum(parts) / parts.sum()])
        curve = (below if form == "passing" else 1.0 - below) * factor
        rows = [[repr(e), repr(v)] for e, v in zip(edges.tolist(), curve.tolist(), strict=True)]
        titles[1] = f"{form} ({sign})"
    elif form == "classes":
        titles[0] = f"class ({unit})"
        pairs = zip(edges[:-1].tolist(), edges[1:].tolist(), values.tolist(), strict=True)
        rows = [[f"{low!r}-{high!r}", repr(value)] for low, high, value in pairs]
    elif form == "edges":
        titles = [f"lower ({unit})", f"upper ({unit})", titles[1]]
        pairs = zip(edges[:-1].tolist(), edges[1:].tolist(), values.tolist(), strict=True)
        rows = [[repr(each) for each in row] for row in pairs]
    else:
        amounts = [*map(repr, values.tolist()), ""]
        rows = [[repr(e), a] for e, a in zip(edges.tolist(), amounts, strict=True)]
    if draw(st.booleans()):
        rows = rows[::-1]
    lines = [separator.join(titles), *(numbers_as(separator.join(row), comma) for row in rows)]
    text = draw(st.sampled_from(["\n", "\r\n", "\r"])).join(lines)
    encoding = draw(st.sampled_from(["utf-8", "utf-8-sig", "utf-16", "cp1252"]))
    return edges * size, shares, text.encode(encoding)


@examples(300, tables())
def test_any_table_in_any_layout_gives_its_shares(table):
    edges, shares, content = table
    with TemporaryDirectory() as folder:
        curve = read_in(Path(folder), content)
    assert curve.edges == pytest.approx(edges, rel=1e-9)
    assert curve.shares == pytest.approx(shares, abs=1e-9)
    assert np.linalg.eigvalsh(curve.covariance).min() > -1e-15
    assert curve.covariance.sum() == pytest.approx(0.0, abs=1e-12)


PIECES = [*(bytes([byte]) for byte in b',;\t."\n\r#[]()<>1-e %_/\x00\xb5\xff'), b"um", b"pan"]


@examples(
    1000,
    st.sampled_from(sorted(LAYOUTS)),
    st.lists(st.tuples(st.integers(0, 10_000), st.integers(0, 3), st.sampled_from(PIECES))),
)
def test_any_damage_is_read_or_refused_in_a_line(name, damage):
    layout, stated = LAYOUTS[name]
    content = bytearray(layout if isinstance(layout, bytes) else layout.encode())
    for place, length, piece in damage:
        place %= len(content) + 1
        content[place : place + length] = piece
    for keys in (ERROR, COUNTED):
        try:
            with TemporaryDirectory() as folder:
                curve = read_in(Path(folder), bytes(content), keys._replace(**stated))
        except ValueError as error:
            assert str(error).isprintable()  # noqa: PT017
            continue
        assert sum(curve.shares) == pytest.approx(1.0)
        assert np.all(np.diff(curve.edges) > 0.0)
        assert np.all(np.isfinite(curve.covariance))


@pytest.mark.parametrize(
    ("amount", "weight"),
    [("finer (%)", "mass"), ("vol undersize (%)", "mass"), ("Q0 (%)", "number")],
)
def test_english_words_and_signs_of_iso_9276_are_known(read, amount, weight):
    known = read(f"size (um),{amount}\n10,20\n20,70\n40,100\n")
    assert known.shares == pytest.approx([0.2, 0.5, 0.3])
    assert known.weight == weight


SIEVES = "sieve (um);{} (%)\n63;0\n125;35\n250;85\n500;100\n"


@pytest.mark.parametrize(("weight", "power"), [("number", 0), ("mass", 3)])
def test_diameters_that_stand_for_a_curve_have_its_shares_and_means(read, weight, power):
    curve = read(SIEVES.format(f"{weight} passing"))
    grains = curve.grains()
    counts, _ = np.histogram(grains, curve.edges)
    assert counts / len(grains) == pytest.approx(curve.shares, abs=1.0 / len(grains))
    # Means of fine steps in the logarithm, in each class.
    ends = [np.geomspace(*pair, 20_001) for pair in zip(curve.edges, curve.edges[1:], strict=False)]
    middles = np.array([np.sqrt(each[1:] * each[:-1]) for each in ends])

    def mean(of, weights, k):
        return np.sum(weights * of ** (k + 1 - power)) / np.sum(weights * of ** (k - power))

    shares = np.array(curve.shares)[:, None] / middles.shape[1]
    for k in (0, 3):
        assert mean(grains, 1.0, k) == pytest.approx(mean(middles, shares, k), rel=2e-4)


@pytest.mark.parametrize("weight", ["number", "area", "mass"])
@pytest.mark.parametrize("amount", ["passing", "share"])
def test_the_error_of_a_mean_is_that_of_curves_with_drawn_errors(read, weight, amount):
    text = SIEVES.format(f"{weight} {amount}")
    if amount == "share":
        text = text.replace("63;0", "63;35").replace("125;35", "125;50").replace("250;85", "250;15")
        text = text.replace("500;100", "500;0").replace("sieve", "lower")
    curve = read(text, CurveKeys(error=1e-3))
    drawn = np.random.default_rng(7).multivariate_normal(
        curve.shares, curve.covariance, 2000, method="eigh"
    )
    power = {"number": 0, "area": 2, "mass": 3}[weight]
    ends = [np.geomspace(*pair, 201) for pair in zip(curve.edges, curve.edges[1:], strict=False)]
    middles = np.array([np.sqrt(each[1:] * each[:-1]) for each in ends]) / 1e-4
    for k in (0, 3):
        above, below = (np.mean(middles ** (k + i - power), axis=1) for i in (1, 0))
        means = drawn @ above / (drawn @ below)
        relative = means.std() / means.mean()
        # The deviation of 2000 draws has the standard error 1/√4000.
        assert curve.mean_error(k) == pytest.approx(relative, rel=4.5 / np.sqrt(4000) + 0.005)
