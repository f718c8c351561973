"""Arithmetic in campaign files agrees with numpy's, and nothing else gets through."""

import math
import re

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from agglom_mpi.config.expression_reader import MAX_NODES, read_comparison, read_expression
from agglom_mpi.config.expressions import (
    PURE,
    common_dimension,
    dimension,
    dimension_of,
    evaluate,
    kind_of,
    names_in,
    satisfied,
    text_of,
    unit_of,
)
from agglom_mpi.declaration.units import to_si

NAMES = ("a", "bb", "c_3")
"""Names that are no units that a number stands before here."""
VALUES = {name: np.array([0.5, -2.0, 3.0, 0.0]) * (i + 1) for i, name in enumerate(NAMES)}


def numbers():
    floats = st.floats(1e-3, 1e3).map(repr)
    return floats | st.integers(0, 1000).map(str)


def texts():
    leaves = numbers() | st.sampled_from(NAMES)
    return st.recursive(
        leaves,
        lambda inner: (
            st.tuples(inner, st.sampled_from([" + ", "-", "*", " / "]), inner).map(
                lambda parts: f"({''.join(parts)})"
            )
            | inner.map(lambda text: f"-({text})")
            | st.tuples(inner, st.integers(-3, 3)).map(lambda pair: f"({pair[0]})**{pair[1]}")
        ),
        max_leaves=12,
    ).filter(lambda text: len(text) <= 400)


@given(texts())
def test_an_expression_has_numpys_value(text):
    node = read_expression(text, NAMES)
    # A plain number is a float here, while Python's integers do not divide by zero.
    tree = {"__builtins__": {}, **VALUES}
    plain = text_of(node, {})
    with np.errstate(all="ignore"):
        expected = eval(plain.replace("(-", "(-np.float64(1)*"), {"np": np}, tree)
        direct = evaluate(node, VALUES)
    assert np.array_equal(direct, expected, equal_nan=True)
    assert set(names_in(node)) <= set(NAMES)


@given(texts())
def test_the_canonical_text_reads_back_to_itself(text):
    plain = text_of(read_expression(text, NAMES), {})
    if len(plain) <= 500:
        assert text_of(read_expression(plain, NAMES), {}) == plain


def refusal(text, known=None):
    """Return why a text is refused, in one line; None if it is not."""
    known = dict.fromkeys(NAMES, PURE) if known is None else known
    try:
        node = read_expression(text, known)
        dimension(node, known)
        return None
    except ValueError as error:
        return f"{type(error).__name__}: {error}"


@given(st.text(max_size=60) | st.text(alphabet="ab(+-*/^. 19e_%[]{}'\"\\,:=<>", max_size=80))
@example("9**9**9")
@example("a**9**9**9")
@example("5 km^99")
@example("1e308 km^99")
@example("1e99999999999999 m")
@example("9" * 400)
@example("__import__('os').system('x')")
@example("().__class__.__bases__")
@example("lambda: 0")
@example("[a for a in (1,)]")
@example("a if a else a")
@example("a := 1")
@example("f'{a}'")
@example("\x00")
@example("\ud800")
@example("a.real")
@example("(" * 250 + "a" + ")" * 250)
@example("-" * 499 + "a")
@example("a" + "**1" * 160)
@example("1" + "+1" * 240)
@example("a" * 500)
@example("5 " + "m*" * 200 + "m")
@example("1e5m" * 100)
def test_any_text_is_read_or_refused_in_one_line(text):
    said = refusal(text)
    assert said is None or said.startswith("ValueError: ")


@pytest.mark.parametrize(
    ("text", "said"),
    [
        (
            "max(a, 1)",
            "which has 'max(a, 1)'; allowed: + - * / **, brackets, names, and",
        ),
        ("a.real", "which has 'a.real'"),
        ("a % 2", "which has 'a % 2'"),
        ("a // 2", "which has 'a // 2'"),
        ("'a'", "which has \"'a'\""),
        ("a +", "which is no arithmetic"),
        ("2 a", "which is no arithmetic"),
        ("2500,5 * a", "is '2500,5 * a'; write a decimal point, and no comma"),
        ("", "which is no arithmetic"),
        ("a < 2", "a comparison; must be a quantity"),
        ("_a", "has the name '_a'; names begin with a letter"),
        ("c_4", "has the unknown name 'c_4'; did you mean 'c_3'?"),
        ("temper", "has the unknown name 'temper'; allowed: a, bb, c_3"),
        ("5 parsnips", "unknown unit 'parsnips' in 'parsnips'"),
        ("1e999", "a number that is too large"),
        ("1" + "+1" * 60, f"is too long; at most {MAX_NODES} numbers, names and operators"),
        ("a" * 501, "has 501 characters; must be at most 500"),
        ("a ** 101", "has the exponent 101 in 'a ** 101'; at most 100 in size"),
        ("9**9**9", "has the exponent 3.8742e+08 in '9 ** (9 ** 9)'"),
        ("a ** bb", "has an exponent that is no plain number in 'a ** bb'"),
        ("2 ** (3 m)", "has an exponent that is no plain number"),
        ("a / 0", "divides by 0 in 'a / 0'"),
        (
            "a + 3 m",
            "does not fit together in 'a + 3 m': 'a' is a pure number, '3 m' is length; "
            "write a number with its unit, like '10 MPa'",
        ),
    ],
)
def test_what_is_no_expression_is_explained(text, said):
    assert said in (refusal(text) or "accepted")


@pytest.mark.parametrize(
    ("text", "unit"),
    [
        ("5 kW/m^3", "W/m^3"),
        ("5 kg/m3 * (2 m/s)^2", "Pa"),
        ("3 m / s * a", "m/s"),
        ("20 degC", "K"),
        ("1 N / 2", "N"),
        ("(4 m^2)**0.5", "m"),
        ("((8 m^3)**(1/3))**3", "m^3"),
        ("6 s ** 2", "s^2"),
        ("1 kg*m^2/s^3/K", "kg*m^2/s^3/K"),
        ("2 kg/s^2 - 0", "J/m^2"),
        ("a", "1"),
    ],
)
def test_units_and_dimensions_are_those_of_pint(text, unit):
    found = dimension(read_expression(text, NAMES), dict.fromkeys(NAMES, PURE))
    assert found == dimension_of(unit)
    assert dimension_of(unit_of(found)) == found
    assert kind_of(found)


@given(
    st.floats(1e-6, 1e6), st.sampled_from(["MPa", "km/s", "g/cm^3", "kJ/mol", "degC", "percent"])
)
def test_a_number_with_a_unit_is_that_of_every_other_field(number, unit):
    si = {"MPa": "Pa", "km/s": "m/s", "g/cm^3": "kg/m^3", "kJ/mol": "J/mol", "degC": "K"}
    value = evaluate(read_expression(f"{number!r} {unit}", ()), {})
    assert value == to_si(f"{number!r} {unit}", si.get(unit, "1"))


@pytest.mark.parametrize("text", ["a**0.0004 < 2", "(a**0.3333)**3 < 7000 kg/m^3"])
def test_a_power_that_is_nearly_simple_is_not_simple(text):
    with pytest.raises(ValueError, match="kg"):
        common_dimension(read_comparison(text, NAMES).operands, {"a": dimension_of("kg/m^3")}, "")


def test_a_power_by_a_fraction_is_simple():
    for text in ("(a**(1/3))**3 < 7000 kg/m^3", "(a**(1 - 2/3))**3 < 7000 kg/m^3"):
        operands = read_comparison(text, NAMES).operands
        density = dimension_of("kg/m^3")
        assert common_dimension(operands, {"a": density}, "") == density


def test_a_zero_has_any_dimension():
    assert dimension(read_expression("0", ()), {}) is None
    assert common_dimension(read_comparison("0 < 5 m", ()).operands, {}, "") == dimension_of("m")


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("a", "must compare two quantities by <, <=, > or >="),
        ("a == 1", "must compare two quantities by <, <=, > or >="),
        ("a < 1 and bb < 1", "must compare two quantities"),
        ("a < 1 or bb < 1", "must compare two quantities"),
        ("not a < 1", "must compare two quantities"),
        ("(a < 1) < 2", "which has 'a < 1'"),
    ],
)
def test_what_is_no_comparison_is_explained(text, said):
    with pytest.raises(ValueError, match=re.escape(said)):
        read_comparison(text, NAMES)


def test_comparisons_chain_and_nan_satisfies_none():
    chain = read_comparison("-1 < a <= 1.5", NAMES)
    assert satisfied(chain, VALUES).tolist() == [True, False, False, True]
    values = {"a": np.array([math.nan, 1.0])}
    assert satisfied(read_comparison("a < 2", NAMES), values).tolist() == [False, True]
    assert satisfied(read_comparison("a >= 0 * a", NAMES), values).tolist() == [False, True]


@pytest.mark.parametrize(
    ("text", "kelvin"),
    [
        ("-5 degC", 268.15),
        ("- 5 degC", 268.15),
        ("\N{MINUS SIGN}5 °C", 268.15),
        ("+5 degC", 278.15),
        ("-(-5 K)", 5.0),
        ("-13 degF", 248.15),
        ("-5 delta_degC", -5.0),
        ("300 K + 20 delta_degC", 320.0),
        ("2 * 10 delta_degC", 20.0),
        ("300 K - 3 K/s * 2 s", 294.0),
    ],
)
def test_a_sign_belongs_to_its_temperature(text, kelvin):
    node = read_expression(text, ())
    assert evaluate(node, {}) == pytest.approx(kelvin, rel=1e-12)
    assert dimension(node, {}) == dimension_of("K")


def test_a_temperature_below_zero_degrees_is_compared_as_one():
    comparison = read_comparison("-5 degC < temperature < 20 degC", ("temperature",))
    given = {"temperature": np.array([267.0, 269.0, 293.0, 294.0])}
    assert satisfied(comparison, given).tolist() == [False, True, True, False]


@pytest.mark.parametrize(
    ("text", "number"),
    [
        ("300 K + 20 degC", "20 degC"),
        ("20 degC - 3 K", "20 degC"),
        ("2 * 10 degC", "10 degC"),
        ("10 degC / 2", "10 degC"),
        ("(10 degC)**2", "10 degC"),
        ("a * (-10 degF)", "-10 degF"),
        ("a -5 degC", "5 degC"),
        ("-(-5 °C)", "-5 °C"),
    ],
)
def test_a_unit_with_an_offset_is_no_operand(text, number):
    said = refusal(text) or "accepted"
    assert f"computes with '{number}', whose unit has an offset" in said
    assert "delta_degC" in said


def test_what_a_run_recorded_is_read_with_an_offset_among_its_operands():
    assert evaluate(read_expression("300 K - 20 degC", (), recorded=True), {}) == 300.0 - 293.15


@pytest.mark.parametrize("text", ["-300 degC", "-500 degF"])
def test_a_temperature_is_not_below_absolute_zero(text):
    assert f"has the temperature '{text}', which is below" in (refusal(text) or "accepted")


def test_numbers_may_be_spelled_as_fortran_writes_them():
    assert evaluate(read_expression("1.0D-1 * 2.5D+01 - .5D0", ()), {}) == 2.0
    assert evaluate(read_expression("1.5D3 m", ()), {}) == 1500.0
    assert dimension(read_expression("2 D", ()), {}) == dimension_of("debye")


@pytest.mark.parametrize("unit", ["dB", "dBm", "Np", "decade", "octave", "dB/m", "Np^2", "dB*s"])
def test_logarithmic_units_are_refused_also_in_compound_ones(unit):
    assert "is logarithmic" in (refusal(f"3 {unit}") or "accepted")
    for field in ("1", "m", "K", "W/m^2/K"):
        for text in (f"3 {unit}", f"3 kg/{unit}"):
            with pytest.raises(ValueError, match="is logarithmic"):
                to_si(text, field)
