import copy
import json
import re
from dataclasses import replace

import numpy as np
import pytest
from rich.console import Console
from set_runs import calibrated

from agglom_mpi.report.set_summary import (
    BIASED_CHOICE,
    grid_table,
    measure_text,
    set_as_dict,
    set_text,
    set_warnings,
)


def printed(content, width=160):
    console = Console(width=width)
    with console.capture() as capture:
        console.print(content)
    return capture.get()


def without_members(found):
    """Return a set whose points are surely no members, which rests on nothing computed before."""
    changed = copy.copy(found)
    for name in ("variables", "directions", "volume_error"):
        vars(changed).pop(name, None)
    none = np.zeros_like(found.points.probability)
    changed.points = found.points._replace(probability=none)
    return changed


def test_the_report_names_the_share_what_is_free_and_what_decides(doubling):
    said = printed(set_text(doubling, doubling.posterior(2.0, 0.05)))
    assert said.startswith("feasible set: mean b/b0 1.9 to 2.1\n")
    lines = said.splitlines()
    [friction] = [line for line in lines if line.startswith("friction  ")][:1]
    assert friction.split()[-1] == ("free" if doubling.variables[-1].free else "decided")
    assert any("near ρv²/H" in line for line in lines)
    assert re.search(r"log\(hardness\).*linear", measure_text(doubling.emulated.box))
    assert f"{doubling.posterior(2.0, 0.05).effective_size:,.0f}" in said


def test_a_warning_names_each_end_that_a_decided_variable_touches(doubling, monkeypatch):
    speed, hardness, friction = doubling.variables
    touching = [
        speed._replace(touches=(), free=False),
        hardness._replace(touches=("lower", "upper"), free=False),
        friction._replace(touches=("lower", "upper"), free=True),
    ]
    monkeypatch.setattr(doubling, "variables", touching)
    [line] = set_warnings(doubling)
    assert "lower end 1e+07" in line
    assert "upper end 2e+08 of hardness" in line


def test_the_search_that_halves_the_error_is_named_where_it_is_another(doubling, monkeypatch):
    assert "aim: set" in printed(set_text(doubling))
    box = doubling.emulated.box
    search = box.campaign.search.model_copy(update={"aim": "set"})
    plan = box.campaign.plan._replace(search=search)
    monkeypatch.setattr(box, "campaign", replace(box.campaign, plan=plan))
    assert "aim: set" not in printed(set_text(doubling))


def test_the_report_says_that_a_search_for_the_best_favours_what_it_liked(doubling, monkeypatch):
    assert BIASED_CHOICE in printed(set_text(doubling), width=400)
    assert set_as_dict(doubling)["set"]["favours_low_objectives"] is True
    monkeypatch.setattr(doubling, "favours_low_objectives", False)
    assert BIASED_CHOICE not in printed(set_text(doubling), width=400)


@pytest.mark.parametrize("width", [40, 60, 80])
def test_no_number_is_cut_on_a_narrow_terminal(doubling, width):
    content = set_text(doubling, doubling.posterior(2.0, 0.05))
    shown = printed(content, width)
    assert set(printed(content).split()) <= set(shown.split())
    assert max(map(len, shown.splitlines())) <= width


def test_an_empty_set_is_called_so_without_quantiles(unreachable, monkeypatch):
    monkeypatch.setattr(unreachable, "calibration", calibrated(unreachable))
    lines = printed(set_text(unreachable)).splitlines()
    [state] = [line for line in lines if line.startswith("the set ")]
    assert state.split()[2] == "empty:"
    assert unreachable.nearest.reached in "\n".join(lines)
    [speed] = [line for line in lines if line.startswith("relative speed (m/s) ")]
    assert speed.split()[-3:] == ["1.2", "upper", "end"]
    assert not any(line.startswith(("share of the box", "expected error")) for line in lines)
    [warning] = [line for line in lines if line.startswith("warning: ")]
    assert "upper end of relative_speed" in warning
    found = json.loads(json.dumps(set_as_dict(unreachable), allow_nan=False))["set"]
    assert found["empty"] is True
    assert found["nearest"]["parameters"] == unreachable.nearest.parameters
    assert found["variables"] == found["directions"] == []
    assert found["expected_error"] is None


def test_names_are_those_of_the_campaign(half, monkeypatch):
    monkeypatch.setattr(half, "calibration", calibrated(half))
    assert "size ratio" not in printed(set_text(half, half.posterior(1.6, "5%")))
    assert re.search(r"log\(hardness\).*linear", measure_text(half.emulated.box))
    assert "size_ratio" not in json.dumps(set_as_dict(half))
    assert grid_table(half, most=16)["volume_fraction"].between(0.1, 0.3).all()


def test_json_holds_the_same_numbers(doubling):
    found = json.loads(json.dumps(set_as_dict(doubling, doubling.posterior(2.0, 0.05))))
    assert found["set"]["volume"] == doubling.volume
    assert found["set"]["variables"][0]["name"] == "relative_speed"
    assert found["set"]["directions"][0]["group"] == "ρv²/H"
    assert found["posterior"]["variables"].keys() == {"relative_speed", "hardness", "friction"}


def test_an_emulator_that_is_not_calibrated_gives_no_set(doubling, monkeypatch):
    monkeypatch.setattr(doubling, "calibration", calibrated(doubling, coverage=0.5))
    first, *rest = printed(set_text(doubling)).splitlines()
    assert doubling.calibration.text in first
    assert "50.0 %" in first
    assert len(rest) == 1
    assert set_as_dict(doubling)["set"] is None


def test_a_set_without_a_volume_has_no_error_of_it(doubling):
    found = without_members(doubling)
    assert found.expected_error == np.inf
    assert not found.empty
    shown = printed(set_text(found))
    assert "inf" not in shown
    assert "smaller than the points that measure it" in shown
    plain = set_as_dict(found)["set"]
    assert plain["expected_error"] is None
    assert plain["samples_to_halve"] is None


def test_the_grid_fills_the_box(doubling):
    table = grid_table(doubling, most=1000)
    assert len(table) == 1000
    assert table["probability"].between(0.0, 1.0).all()
    assert table["probability"].mean() == pytest.approx(doubling.volume, abs=0.02)
