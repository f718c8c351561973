import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from agglom_mpi.variables import PAPER_VARIABLES, TEN, Limits, Variable, VariableTable

SPREAD = Variable("sizes.spread", "1", "s", "")
TIME = Variable("end_time", "s", "T", "")


def test_the_ten_come_first_and_others_by_name():
    table = VariableTable([SPREAD, TIME])
    assert table.names == (*TEN.names, "end_time", "sizes.spread")
    assert table.count == len(table.names) == 12
    assert table.further_names == ("end_time", "sizes.spread")
    assert table == VariableTable([TIME, SPREAD]) != TEN
    assert table["end_time"].unit == "s"
    assert "end_time" in table
    assert "end_time" not in TEN
    assert table.index("sizes.spread") == 11


def test_a_table_knows_of_which_sections_it_has_numbers():
    table = VariableTable([SPREAD, TIME])
    assert [name for name in ("sizes", "end_time", "size") if table.has_numbers_of(name)] == [
        "sizes",
        "end_time",
    ]
    assert not TEN.has_numbers_of("hardness")  # a variable of the papers, none of the scene


def test_two_variables_of_one_name_are_no_table():
    with pytest.raises(ValueError, match="name"):
        VariableTable([SPREAD, SPREAD])
    with pytest.raises(ValueError, match="name"):
        VariableTable(PAPER_VARIABLES[:1])


def test_strings_are_read_by_name():
    table = VariableTable([SPREAD])
    strings = np.arange(22.0).reshape(2, 11)
    assert table.values_by_name(strings[0])["sizes.spread"] == 10.0
    assert table.columns_by_name(strings)["density"].tolist() == [2.0, 13.0]
    with pytest.raises(ValueError, match="shorter"):
        table.values_by_name(strings[0, :10])


def test_strings_of_another_table_keep_what_both_have():
    one, other = VariableTable([SPREAD]), VariableTable([SPREAD, TIME])
    strings = np.arange(22.0).reshape(2, 11)
    found = other.of_other(strings, one)
    assert np.isnan(found[:, other.index("end_time")]).all()
    assert found[:, other.index("sizes.spread")].tolist() == [10.0, 21.0]
    assert np.array_equal(one.of_other(found, other), strings)
    assert one.of_other(strings, one) is strings


@given(st.floats(allow_nan=True), st.floats(-5, 5), st.floats(-5, 5))
def test_a_limit_is_named_exactly_where_it_is_broken(number, low, high):
    finite = np.isfinite(number)
    for limits, holds in (
        (Limits(above=low), number > low),
        (Limits(at_least=low), number >= low),
        (Limits(at_most=high), number <= high),
        (Limits(below=high), number < high),
        (Limits(), True),
    ):
        assert (limits.broken_by(number) == "") == (finite and holds)
