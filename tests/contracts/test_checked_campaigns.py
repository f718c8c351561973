"""`agglom check --allow-code` tests own components: one line for what fails, and what is broken."""

import json
import subprocess

import pytest
from click.testing import CliRunner
from own_components import RESTITUTION_LINE, SPEED, write_scene
from user_function_runs import write_own

from agglom_mpi import load_campaign
from agglom_mpi.cli.check import check
from agglom_mpi.compilation.kernels import runs_compiled
from agglom_mpi.contracts import tested_components
from agglom_mpi.contracts.promises import SPEED_RATIOS, _rebound
from agglom_mpi.contracts.tested_components import BrokenComponentError
from agglom_mpi.launcher import python_command
from agglom_mpi.physics import scales
from agglom_mpi.runtime.invert import InvertOptions, read_request

pytestmark = pytest.mark.usefixtures("few_cases")

COMPILED = pytest.mark.skipif(not runs_compiled(), reason="nothing is compiled")
FORMULA = "deficit = 1.0 - min(1.0, (self.speed / pair.approach_speed) ** 0.25)"


def checked(path, *options):
    """Return exit code, output, and the lines on standard error."""
    result = CliRunner().invoke(check, [str(path), "--allow-code", *options])
    return result.exit_code, result.stdout, result.stderr.splitlines()


def test_an_own_law_that_holds_is_listed_with_its_properties(tmp_path):
    code, output, complaints = checked(write_scene(tmp_path), "--json")
    assert code == 0
    assert complaints == []
    line, rebound = json.loads(output)["properties"]
    assert rebound.startswith("sticking.py:SpeedRestitution: e of the mean pair: ")
    assert line.startswith("sticking.py:SpeedRestitution ")
    held = {"finite", "symmetry", "frame", "units", "range", "energy"}
    assert held <= set(line.replace(",", "").split())


def test_each_property_that_fails_is_one_line_with_exit_code_2(tmp_path):
    source = SPEED.replace(FORMULA, FORMULA.replace("min(1.0", "min(1.2"))
    code, output, lines = checked(write_scene(tmp_path, source))
    assert code == 2
    assert output == ""
    properties = [line.split(": ")[:2] for line in lines]
    assert properties == [
        ["sticking.py:SpeedRestitution", "range"],
        ["sticking.py:SpeedRestitution", "energy"],
    ]
    assert all("; at approach_speed=" in line for line in lines)


def test_a_property_that_the_class_breaks_is_printed_with_its_reason(tmp_path):
    declared = '    breaks = {"units": "a number of the sieve"}\n    summary'
    source = SPEED.replace("    summary", declared).replace(FORMULA, FORMULA + " * 1.0")
    source = source.replace("pair.approach_speed) **", "pair.approach_speed**0.9) **")
    code, output, complaints = checked(write_scene(tmp_path, source), "--json")
    assert code == 0, complaints
    breaks, held, _ = json.loads(output)["properties"]
    assert breaks == "sticking.py:SpeedRestitution means to break units: a number of the sieve"
    assert "units" not in held


def test_a_break_of_no_property_is_refused(tmp_path):
    source = SPEED.replace("    summary", '    breaks = {"unit": "?"}\n    summary')
    code, _, [line] = checked(write_scene(tmp_path, source))
    assert code == 2
    assert line.startswith("sticking.py:SpeedRestitution: breaks: ")
    assert "'unit'" in line


@COMPILED
def test_what_does_not_compile_is_one_line_with_its_place(tmp_path):
    source = SPEED.replace("pair.approach_speed) **", "pair.aproach_speed) **")
    line = next(i for i, text in enumerate(source.splitlines(), 1) if "aproach" in text)
    code, _, complaints = checked(write_scene(tmp_path, source))
    assert code == 2
    [complaint] = complaints
    assert complaint.startswith(f"sticking.py:{line}: ")


def test_a_law_that_lacks_a_formula_is_refused_at_its_field(tmp_path):
    source = SPEED.replace("def solve_restitution", "def solve")
    code, _, complaints = checked(write_scene(tmp_path, source))
    assert code == 2
    assert len(complaints) == 1
    assert "solve_restitution" in complaints[0]
    assert f"own.yaml:{RESTITUTION_LINE}:" in complaints[0]


@pytest.mark.parametrize(("highest", "expected"), [(0.9, 0), (1.5, 2)])
def test_the_law_is_tested_over_the_range_that_a_campaign_searches(tmp_path, highest, expected):
    source = SPEED.replace(FORMULA, "deficit = 1.0 - self.speed").replace(
        'In("m/s", above', 'In("1", above'
    )
    searched = f"density: 2500, restitution.speed: [0.1, {highest}]"
    edits = ("speed: 3 m/s, ", ""), ("density: 2500", searched)
    code, _, lines = checked(write_scene(tmp_path, source, *edits))
    assert code == expected
    assert all(": range: " in line or ": energy: " in line for line in lines)


def test_the_published_heat_is_printed_as_what_breaks_the_frame(tmp_path):
    path = write_scene(tmp_path, SPEED, ("heating: none", "heating: own_energy"))
    text = path.read_text().replace("density: 2500", "density: 2500, heat_capacity: 1000")
    path.write_text(text.replace("heat_capacity: 1000", "heat_capacity: 1000, temperature: 300"))
    result = CliRunner().invoke(check, [str(path), "--allow-code", "--json"])
    assert result.exit_code == 0, result.stderr
    lines = json.loads(result.stdout)["properties"]
    broken = [line.split(": ")[0] for line in lines if "means to break" in line]
    assert broken == [
        "heating own_energy means to break frame",
        "heating own_energy means to break energy",
    ]


@COMPILED
def test_a_division_by_zero_that_compiled_code_survives_is_no_failure(tmp_path):
    safe = "deficit = 1.0 - min(1.0, self.speed / pair.slip_speed)"
    code, _, complaints = checked(write_scene(tmp_path, SPEED.replace(FORMULA, safe)))
    assert complaints == []
    assert code == 0


def test_a_run_tests_own_components_before_its_first_leg_alone(tmp_path, monkeypatch):
    broken = SPEED.replace(FORMULA, "deficit = 0.5 * pair.radius_i / pair.radius_j")
    path, shown = write_scene(tmp_path, broken), []
    options = InvertOptions(str(path), str(tmp_path / "own.h5"), allow_code=True)
    with pytest.raises(BrokenComponentError) as caught:
        read_request(options, shown.append)
    assert "sticking.py:SpeedRestitution: symmetry: " in str(caught.value)
    assert not (tmp_path / "own.h5").exists()
    (tmp_path / "own.h5").touch()  # of an earlier leg
    read_request(options, shown.append)
    assert not any(line.startswith("sticking.py") for line in shown)


def test_e_of_the_mean_pair_is_a_line_on_a_restitution_of_ones_own(tmp_path):
    campaign = load_campaign(write_scene(tmp_path), allow_code=True)
    [line] = _rebound(campaign)
    section, values = campaign.at(campaign.parameters())
    mean = scales.mean_approach(section, values)
    found = [each.split() for each in line.removesuffix(" m/s").split(": ")[-1].split(", ")]
    assert [float(speed) for _, _, speed in found] == pytest.approx(
        [ratio * mean for ratio in SPEED_RATIOS], rel=6e-3
    )
    for e, _, speed in found:
        if float(speed) < 0.3:
            assert e == "sticks"
        else:
            assert float(e) == pytest.approx(min(1.0, (3.0 / float(speed)) ** 0.25), abs=6e-3)


def test_a_fault_that_comes_and_goes_has_a_reason(tmp_path, monkeypatch):
    monkeypatch.setattr(tested_components, "runs_compiled", lambda: False)
    source = SPEED.replace("from typing", "import random\nfrom typing", 1)
    changing = "deficit = random.random()"
    code, _, lines = checked(write_scene(tmp_path, source.replace(FORMULA, changing)))
    assert code == 2
    assert lines
    assert all(line.split(": ")[2].strip("; ") for line in lines)


COUNTING = """
CALLS = []

def worth(sample):
    CALLS.append(1)
    return len(CALLS)
"""


def test_a_function_that_returns_another_value_when_it_is_called_again_is_refused(tmp_path):
    code, _, [line] = checked(write_own(tmp_path, COUNTING))
    assert code == 2
    assert "returns 1.0 and then 2.0" in line


ENDLESS = "while pair.approach_speed > 0.0:\n            pass\n        deficit = 0.0"
CHECK = """
import os, signal, sys, threading, time
from agglom_mpi.cli.check import check
from agglom_mpi.contracts import tested_components

def interrupt():
    while time.process_time() < {start}:
        time.sleep(0.1)
    os.kill(os.getpid(), signal.SIGINT)

tested_components.MAX_TEST_SECONDS = {limit}
threading.Thread(target=interrupt, daemon=True).start()
sys.argv = ["agglom", {path!r}, "--allow-code"]
check()
"""


@pytest.mark.slow
@pytest.mark.parametrize(("limit", "start", "code"), [(3.0, 1e9, 2), (1e9, 12.0, -2)])
@COMPILED
def test_a_check_of_an_endless_formula_ends(tmp_path, limit, start, code):
    """At its limit, and by Ctrl-C; the formula runs after some seconds of processor time."""
    path = write_scene(tmp_path, SPEED.replace(FORMULA, ENDLESS))
    words = python_command(CHECK.format(limit=limit, start=start, path=str(path)))
    done = subprocess.run(words, capture_output=True, text=True, timeout=600)
    assert done.returncode == code
    assert "Traceback" not in done.stderr
    assert code < 0 or "sticking.py:SpeedRestitution: " in done.stderr
