"""Options that exclude each other are refused before anything is written; all others answered."""

import json
import shutil

import pytest

NEXT = ["report", "tiny.h5", "--out", "OUT", "--posterior", "--what-next", "--what-next-table"]


@pytest.mark.parametrize(
    ("words", "named"),
    [
        (["check", "tiny.h5", "--strict"], "--strict"),
        (["simulate", "tiny.h5", "--string", "0", "--strict"], "--strict"),
        (["simulate", "tiny.yaml", "--samples", "2", "--sample", "0"], "--samples"),
        (["plan", "tiny.yaml", "--from", "tiny.h5", "--seconds", "20"], "--seconds"),
        (["accuracy", "tiny.yaml", "-o", "OUT", "--map", "--history", "tiny.h5"], "--history"),
        (["accuracy", "SCENES", "-o", "OUT", "--history", "tiny.h5"], "--history"),
        (["accuracy", "SCENES", "-o", "OUT", "--set", "density=6000"], "--set"),
        (["export", "tiny.h5", "--compact", "OUT", "--unused"], "--unused"),
        (["report", "tiny.h5", "--feasible-set", "--posterior"], "--posterior"),
        (["kernels", "tiny.yaml", "--impose", "1", "nan", "1"], "--impose"),
        (["kernels", "tiny.yaml", "--error", "nan"], "--error"),
        (["kernels", "tiny.yaml", "--csv", "k", "--netcdf", "k"], "--csv and --netcdf"),
        ([*NEXT, "OUT.csv", "--feasible-set", "--grid", "OUT.csv"], "--grid and --what-next-table"),
        (["report", "tiny.h5", "--posterior", "--what-next-table", "OUT"], "--what-next"),
        (["export", "tiny.h5", "--csv", "OUT", "--frames", "5"], "--paraview"),
    ],
)
def test_an_option_that_another_one_would_drop_is_refused(agglom, tmp_path, words, named):
    (tmp_path / "scenes").mkdir()
    shutil.copy("tiny.yaml", tmp_path / "scenes")
    places = {"OUT": tmp_path / "out", "SCENES": tmp_path / "scenes"}
    for name, place in places.items():
        words = [word.replace(name, str(place)) for word in words]
    done = agglom(*words)
    assert done.exit_code == 2, done.output
    assert named in done.stderr
    assert "Traceback" not in done.stderr
    assert [path.name for path in tmp_path.iterdir()] == ["scenes"]


@pytest.mark.usefixtures("remembered")
def test_a_sensitivity_is_shown_beside_a_feasible_set(three, agglom):
    asked = ("report", three.path, "--feasible-set")
    both = json.loads(agglom(*asked, "--sensitivity", "--json").stdout)
    assert set(both["sensitivity"]["variables"]) == {"relative_speed", "hardness", "friction"}
    shown = agglom(*asked, "--sensitivity").stdout
    assert both["criterion"] in shown
    assert f"{both['sensitivity']['variables']['friction']['total']:.1%}" in shown
