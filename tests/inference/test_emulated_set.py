"""Probabilities averaged over deviations: their mean, edges of the box, and what shows them."""

import numpy as np
import pytest

from agglom_mpi import load_emulator
from agglom_mpi.inference.emulated_set import DEVIATIONS, Wobble, even_places
from agglom_mpi.report.sections.section import plain_text
from agglom_mpi.report.set_summary import set_as_dict, set_text


@pytest.fixture(scope="module")
def robust(three):
    """Return the set with hardnesses that deviate by up to 20 %."""
    return three.feasible_set("10%", {"hardness": "20%"})


def test_deviations_are_even_in_each_variable():
    middles = (2.0 * np.arange(DEVIATIONS) + 1.0) / DEVIATIONS - 1.0
    assert np.allclose(np.sort(even_places(3), axis=0), middles[:, None])


def test_the_probability_is_the_mean_over_deviations(three, robust):
    alone = three.feasible_set("10%")
    strings = alone.emulated.box.even_strings(128)
    wobble, places = robust.emulated.wobble, np.linspace(-1.0, 1.0, 201)[:, None]
    assert np.allclose(wobble.wobbled(strings, np.array([1.0]))[0, 3] / strings[0, 3], 1.2)
    moved = [alone.emulated.probability(wobble.wobbled(strings, place)) for place in places]
    exact, found = np.mean(moved, axis=0), robust.emulated.probability(strings)
    # A mean over even deviations is off by at most the variation over twice their number (Koksma).
    variation = np.abs(np.diff(moved, axis=0)).sum(axis=0)
    assert np.all(np.abs(found - exact) <= variation * (0.5 / DEVIATIONS + 0.5 / 200) + 1e-12)
    assert np.abs(found - alone.emulated.probability(strings)).max() > 0.1


def test_deviations_end_at_the_edge_of_the_box(three):
    box = three.feasible_set("10%").emulated.box
    strings = box.even_strings(256)
    drawn = Wobble(box, {"hardness": 0.9}).drawn(strings, np.random.default_rng(651))
    assert box.inside(drawn).all()
    assert {*drawn[:, 3].tolist()} > {float(box.space.lower[3]), float(box.space.upper[3])}


def test_without_deviations_nothing_changes(three):
    box = three.feasible_set("10%").emulated.box
    strings = box.even_strings(16)
    still = Wobble(box, {})
    assert not still
    assert still.drawn(strings, np.random.default_rng(1)) is strings
    assert still.mean(lambda strings: strings, strings) is strings


def test_an_emulator_averages_as_its_set_does(three, robust):
    emulator = load_emulator(three.path, "10%")
    strings = {"relative_speed": [3.0, 4.5], "hardness": ["40 MPa", "67 MPa"]}
    strings["friction"] = [0.3, 0.1]
    given = {"hardness": "20%"}
    assert emulator.probability(strings, given) == pytest.approx(robust.probability(strings))
    assert emulator.probability(strings) == pytest.approx(emulator.probability(strings, {}))


def test_report_and_json_state_the_deviations(robust):
    found = set_as_dict(robust)
    assert found["robust"] == {"hardness": 0.2}
    assert "hardness by up to 20 %" in found["criterion"]
    assert found["set"]["expected_error"] is found["set"]["samples_to_halve"] is None
    assert "hardness by up to 20 %" in plain_text(set_text(robust), 200)
    assert 0.0 <= robust.inner <= robust.volume <= robust.outer
    assert robust.volume_error > 0.0


@pytest.mark.parametrize("given", [{"density": "5%"}, {"hardness": 2}, {"hardness": "much"}])
def test_an_impossible_deviation_is_named(three, given):
    [name] = given
    with pytest.raises(ValueError, match=rf"robust\.{name}: is "):
        three.feasible_set("10%", given)
