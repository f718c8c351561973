"""Files of impacts: what is read, and what is refused with line, column and value."""

import math

import pytest

from agglom_mpi.declaration.declared import FieldError
from agglom_mpi.measurements.files.impact_file import MAX_IMPACTS, WALL_RATIO, read_impacts
from agglom_mpi.measurements.files.size_columns import CurveKeys

GOOD = """\
# Somebody, 1999
Impact speed (cm/s);Diameter 1 (mm);Diameter 2 (mm);T;temperature (degC);coefficient (%)
10;2;wall;x;26.85;90
100;2;4;;126.85;0
"""


def read(folder, text, error=0.02, **headings):
    (folder / "i.csv").write_text(text)
    return read_impacts(folder, "i.csv", CurveKeys(error=error, headings=headings))


def test_impacts_are_read_in_si_units(tmp_path):
    found = read(tmp_path, GOOD)
    assert found.speeds == pytest.approx((0.1, 1.0))
    assert found.radii == pytest.approx((1e-3, 1e-3))
    assert found.other_radii == pytest.approx((WALL_RATIO * 1e-3, 2e-3))
    assert found.temperatures == pytest.approx((300.0, 400.0))
    assert found.coefficients == pytest.approx((0.9, 0.0))
    assert found.errors == (0.02, 0.02)


def test_equal_grains_have_one_radius_and_errors_their_own_column(tmp_path):
    text = "velocity (m/s),radius (um),restitution,sd\n1,5,0.5,0.1\n2,5,0.4,0.2\n"
    found = read(tmp_path, text, None)
    assert found.other_radii == found.radii == pytest.approx((5e-6, 5e-6))
    assert found.errors == (0.1, 0.2)
    assert all(map(math.isnan, found.temperatures))


def test_an_entry_states_what_other_headings_mean(tmp_path):
    text = "v;r;e\n1;2;0.5\n"
    found = read(tmp_path, text, v="speed (m/s)", r="radius (mm)", e="coefficient")
    assert (found.speeds, found.radii, found.coefficients) == ((1.0,), (2e-3,), (0.5,))


HEAD = "speed (m/s);radius (mm);coefficient\n"
REFUSED = {
    "no speed": ("radius (mm);coefficient\n1;0.5\n", ("speed (m/s)",)),
    "no radius": ("speed (m/s);coefficient\n1;0.5\n", ("radius (mm)",)),
    "no coefficient": ("speed (m/s);radius (mm)\n1;0.5\n", ("coefficient",)),
    "two speeds": ("speed (m/s);velocity (m/s);radius (mm);coefficient\n1;1;1;1\n", ("velocity",)),
    "a speed without a unit": ("speed;radius (mm);coefficient\n1;1;0.5\n", ("speed", "m/s")),
    "a radius in kg": ("speed (m/s);radius (kg);coefficient\n1;1;0.5\n", ("radius", "'kg'")),
    "a speed of 0": (HEAD + "1;1;0.5\n0;1;0.5\n", ("line 3", "speed", "'0'")),
    "a negative radius": (HEAD + "1;-1;0.5\n", ("line 2", "radius", "'-1'")),
    "a negative coefficient": (HEAD + "1;1;-0.1\n", ("line 2", "coefficient", "-0.1", "0 to 1.2")),
    "a percentage without its unit": (HEAD + "1;1;85\n", ("line 2", "coefficient", "85")),
    "a text": (HEAD + "1;1;0.5\n1;1;stuck\n", ("line 3", "coefficient", "stuck")),
    "no rows": ("run,5\nspeed (m/s),radius (mm),coefficient\n", ("no impacts",)),
    "too many": (HEAD + "1;1;0.5\n" * (MAX_IMPACTS + 1), (f"{MAX_IMPACTS}",)),
}


@pytest.mark.parametrize("name", REFUSED)
def test_what_is_wrong_is_named(tmp_path, name):
    text, wanted = REFUSED[name]
    with pytest.raises(ValueError, match=r"i\.csv") as caught:
        read(tmp_path, text)
    assert all(each in str(caught.value) for each in wanted), caught.value


@pytest.mark.parametrize(("text", "error"), [(HEAD + "1;1;0.5\n", None)])
def test_an_error_must_be_given(tmp_path, text, error):
    with pytest.raises(FieldError) as caught:
        read(tmp_path, text, error)
    assert caught.value.problems[0][0] == ("error",)


def test_an_error_must_be_given_once_and_be_a_number(tmp_path):
    text = "speed (m/s);radius (mm);coefficient;error\n1;1;0.5;0.1\n"
    with pytest.raises(FieldError):
        read(tmp_path, text, 0.1)
    with pytest.raises(ValueError, match="line 2, column 'error'"):
        read(tmp_path, text.replace("0.1", "0"), None)
    with pytest.raises(ValueError, match="greater than 0 and at most 1"):
        read(tmp_path, text.replace("0.1", "1.5"), None)


def test_headings_that_the_file_lacks_are_refused(tmp_path):
    with pytest.raises(FieldError):
        read(tmp_path, HEAD + "1;1;0.5\n", w="speed (m/s)")
