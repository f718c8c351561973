"""Numbers are shown in the units that the campaign file writes, else in ones that suit them."""

import pytest

from agglom_mpi.analysis.shown_units import TIME, shown_unit

TEXT = """
scene: {end_time: 0.1 s, half_width: 4 cm}
variables:
  relative_speed: [1 cm/s, 2 m/s, log]
  hardness: [1e-2 GPa, 1 GPa]
  density: 2 g/cm^3
  temperature: 20 degC
  surface_energy: [0.01, 1]
  restitution.viscosity: [1 mPa*s, 1e3 mPa*s, log]
data:
  - {quantity: sizes, file: sieve.csv}
  - {quantity: d50, value: 120 um, error: 0.01 mm, time: 20 ms}
  - {quantity: temperature, value: 330 K, error: 1 K}
"""


def shown(name, unit, largest, text=TEXT):
    return shown_unit(text, name, unit, largest)


@pytest.mark.parametrize(
    ("name", "unit", "factor", "label"),
    [
        ("hardness", "Pa", 1e9, "GPa"),
        ("density", "kg/m^3", 1e3, "g/cm³"),
        ("restitution.viscosity", "Pa*s", 1e-3, "mPa·s"),
        ("half_width", "m", 1e-2, "cm"),
        ("d50", "m", 1e-6, "µm"),
        ("mean_diameter", "m", 1e-6, "µm"),  # as the other diameters
        ("sizes", "m", 1e-6, "µm"),
        (TIME, "s", 1e-3, "ms"),  # of the data rather than of the scene
    ],
)
def test_a_number_is_shown_in_the_unit_that_the_campaign_writes(name, unit, factor, label):
    assert shown(name, unit, 1e-3) == (pytest.approx(factor), label)


@pytest.mark.parametrize(
    ("name", "unit", "largest", "found"),
    [
        ("relative_speed", "m/s", 2.0, (1.0, "m/s")),  # its ends have different units
        ("temperature", "K", 293.0, (1.0, "K")),  # 0 °C is not 0 K
        ("surface_energy", "J/m^2", 1.0, (1.0, "J/m²")),
        ("another", "Pa", 2e7, (1e6, "MPa")),
    ],
)
def test_without_one_unit_in_the_campaign_a_suitable_one_is_chosen(name, unit, largest, found):
    assert shown(name, unit, largest) == found


@pytest.mark.parametrize("text", ["variables: [", "- 1", "data: 3", "variables: {hardness: 3 kg}"])
def test_a_damaged_text_leaves_the_choice_to_the_size(text):
    assert shown("hardness", "Pa", 2e7, text) == (1e6, "MPa")


def test_the_unit_of_a_column_is_that_of_its_sizes():
    text = "data: [{quantity: d50, value: 1 mm}, {quantity: sizes, file: a.csv, unit: um}]"
    assert shown("sizes", "m", 1.0, text) == (pytest.approx(1e-6), "µm")
    assert shown("d50", "m", 1.0, text) == (pytest.approx(1e-3), "mm")
