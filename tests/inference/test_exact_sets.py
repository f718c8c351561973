"""Sets of questions without noise: the emulator knows more than it claims, and that is no fault."""

import math

import numpy as np
import pytest
from campaign_runs import finish
from set_runs import three_variable_file, three_variable_text

from agglom_mpi import open_campaign
from agglom_mpi.display.terminal import PlainConsole
from agglom_mpi.report.set_summary import set_text
from agglom_mpi.storage.reader import read_campaign

EXACT = """
import math
def worth(sample):
    given = sample.parameters
    return 1.0 + math.log(given["relative_speed"]) - 0.5 * math.log(given["hardness"] / 1e7)
"""


def printed(found):
    console = PlainConsole(width=200)
    with console.capture() as capture:
        console.print(set_text(found))
    return capture.get()


@pytest.fixture(scope="module")
def exact(tmp_path_factory):
    """Return the set of a function of the parameters alone, at most 1.5."""
    folder = tmp_path_factory.mktemp("exact")
    (folder / "shape.py").write_text(EXACT)
    law = "{law: function, call: 'shape:worth'}"
    text = three_variable_text(generations=8, final="none", objective=law)
    (folder / "three.yaml").write_text(text)
    finish(folder, "three.yaml", "-q", "--allow-code")
    return open_campaign(folder / "three.h5").feasible_set(1.5)


def test_a_function_without_noise_has_a_sharp_set(exact):
    assert exact.calibration.too_wide
    assert math.isnan(exact.calibration.width)  # there is a bound, but no band
    # v ≤ √(e H / 10 MPa) m/s, over [0.1, 30] m/s and a factor of 20 in H by its logarithm.
    slowest = 2.0 * math.exp(0.5) * (math.sqrt(20.0) - 1.0) / math.log(20.0)
    volume = (slowest - 0.1) / 29.9
    assert exact.volume == pytest.approx(volume, rel=0.05)
    assert exact.outer - exact.inner < 0.1 * volume
    assert exact.expected_error < 0.05
    assert exact.directions["relative_speed"][0] == pytest.approx(1.0)
    assert exact.directions["hardness"][0] == pytest.approx(-0.5, abs=0.03)
    assert "knows more than it claims" in printed(exact)


def test_a_mean_that_is_the_same_everywhere_is_known(tmp_path):
    replaced = {"ratio: 2": "ratio: 1", "[10 MPa, 200 MPa, log]": "[1e20, 1e21, log]"}
    path = three_variable_file(tmp_path, replaced | {"[0.1, 30]": "[1, 30]"}, generations=4)
    found = open_campaign(path).feasible_set(0.05)
    assert np.ptp(open_campaign(path).samples["mean_radius_ratio"]) == 0.0
    assert (found.volume, found.expected_error) == (pytest.approx(1.0), pytest.approx(0.0))
    assert found.calibration.width < 0.5
    assert found.directions.empty
    assert all(each.free for each in found.variables)
    said = printed(found)
    assert "of the tolerance" in said
    assert "what decides" not in said
    pytest.importorskip("matplotlib")
    from agglom_mpi.report.figures.figure import FigureOptions, figures

    data, options = read_campaign(path), FigureOptions(feasible_set=found)
    drawn = [each for each in figures().values() if each.section == "set"]
    names = [each.name for each in drawn if each.drawing(data, options) is not None]
    assert names == ["set_pairs"]
