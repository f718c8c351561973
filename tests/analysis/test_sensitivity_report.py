import numpy as np
import pytest
from rich.console import Console

from agglom_mpi.analysis.sensitivity import Sensitivity, as_dict, sensitivity_table

FOUND = Sensitivity(np.array([0.1, 0.6]), np.array([0.2, 0.7]), 40, 0.9, 0.08)


def printed(content):
    console = Console(width=200)
    with console.capture() as capture:
        console.print(content)
    return capture.get()


def test_what_matters_most_comes_first():
    lines = printed(sensitivity_table(("density", "hardness"), FOUND)).splitlines()
    rows = [line.split() for line in lines if line.endswith("% ") or "%  " in line]
    assert [row[0] for row in rows[:2]] == ["hardness", "density"]
    assert rows[0][1:] == ["60.0%", "70.0%"]
    assert "40 strings" in lines[-1]
    assert "90%" in lines[-1]


def test_numbers_are_named_by_their_variables():
    assert as_dict(("density", "hardness"), FOUND)["variables"] == {
        "density": {"first_order": 0.1, "total": 0.2},
        "hardness": {"first_order": 0.6, "total": 0.7},
    }


@pytest.mark.parametrize("made", [as_dict, sensitivity_table])
def test_nothing_is_made_up_where_nothing_is_known(made):
    assert made(("density",), None) in (
        None,
        "sensitivity: too few strings, or all of them are worth the same",
    )
