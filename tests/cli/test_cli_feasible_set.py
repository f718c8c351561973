import csv
import json
import re

import pytest
from click.testing import CliRunner
from set_runs import three_variable_file
from threadpoolctl import threadpool_info

MEASURED = ["--measured", "2", "--error", "1%"]


pytestmark = pytest.mark.usefixtures("remembered")


@pytest.fixture
def path(three):
    return three.path


def report(*arguments):
    from agglom_mpi.cli import main

    words = ["report", *map(str, arguments)]
    return CliRunner().invoke(main, words)


def test_the_set_is_printed_with_its_posterior_and_written(path, tmp_path):
    draws, grid = tmp_path / "draws.csv", tmp_path / "grid.csv"
    options = ["--measured", 2, "--error", "5%", "--draws", draws, "--grid", grid]
    done = report(path, "--feasible-set", "--tolerance", "10%", *options)
    assert done.exit_code == 0, done.output
    assert done.stdout.startswith("feasible set: mean b/b0 1.8 to 2.2")
    assert "posterior, given a measured mean b/b0 of 2 ± 0.1" in done.stdout
    with draws.open() as file:
        rows = list(csv.DictReader(file))
    assert sum(float(row["weight"]) for row in rows) == pytest.approx(1.0)
    assert set(rows[0]) == {"relative_speed (m/s)", "hardness (Pa)", "friction", "weight"}
    with grid.open() as file:
        assert all(0.0 <= float(row["probability"]) <= 1.0 for row in csv.DictReader(file))


def test_reports_compute_in_one_thread_also_beside_a_running_campaign(path, monkeypatch):
    from agglom_mpi.report import set_files

    threads, text = set(), set_files.set_text

    def seen(*arguments):
        threads.update(each["num_threads"] for each in threadpool_info())
        return text(*arguments)

    monkeypatch.setattr(set_files, "set_text", seen)
    done = report(path, "--feasible-set")
    assert done.exit_code == 0, done.output
    assert threads == {1}


def test_json_is_alone_on_standard_output(path):
    done = report(path, "--feasible-set", "--json")
    assert json.loads(done.stdout)["set"]["volume"] > 0.0


def test_existing_files_are_kept(path, tmp_path):
    (tmp_path / "grid.csv").write_text("mine")
    done = report(path, "--feasible-set", "--grid", tmp_path / "grid.csv")
    assert done.exit_code == 2
    assert (tmp_path / "grid.csv").read_text() == "mine"


@pytest.mark.parametrize(
    ("options", "said"),
    [
        (["--tolerance", "5%"], "--tolerance is for --feasible-set"),
        (["--robust", "hardness=5%"], "--robust is for --feasible-set"),
        (["--feasible-set", "--robust", "wind=5%"], "robust.wind: is no searched variable"),
        (["--feasible-set", "--robust", "5%"], "is not NAME=VALUE"),
        (["--feasible-set", "--tolerance", "wide"], "tolerance: is 'wide'; must be greater than 0"),
        (["--feasible-set", "--tolerance", "-5%"], "tolerance: is -5%; must be greater than 0"),
        (["--feasible-set", "--tolerance", "5"], "did you mean '5%'?"),
        (["--feasible-set", "--measured", "nan", "--error", "0.1"], "must be a finite number"),
        (["--feasible-set", "--measured", "2", "--error", "5"], "did you mean '5%'?"),
        (["--feasible-set", "--measured", "2", "--error", "0"], "error: is 0; must be greater"),
        (["--feasible-set", "--measured", "2"], "--measured and --error go together"),
        (["--feasible-set", "--draws", "x.csv"], "--draws is for --measured"),
        (["--feasible-set", "--error", "2%"], "--error is for --measured"),
    ],
)
def test_options_that_make_no_sense_are_told(path, options, said):
    done = report(path, *options)
    assert done.exit_code == 2
    assert said in done.stderr


@pytest.mark.parametrize(
    ("options", "said"),
    [
        (
            ["--feasible-set", "--measured", "2", "--error", "1e300"],
            "must be 0 or in size between 1e-100 and 1e+100",
        ),
        (["--feasible-set", "--measured", "2,5", "--error", "1%"], "a decimal point, and no comma"),
        (
            ["--feasible-set", "--measured", "-2", "--error", "1"],
            "measured: is -2; must be greater",
        ),
        (["--feasible-set", "--measured", "50", "--error", "1"], "measured: is 50; 100 grains in"),
        (
            ["--feasible-set", *MEASURED, "--draws", "x.csv", "--grid", "./x.csv"],
            "--draws and --grid name the same file",
        ),
        (
            ["--feasible-set", "--grid", "page/set_pairs.png", "--out", "page"],
            "--grid names a file of the web page",
        ),
        (["--feasible-set", "--grid", "no/where/x.csv"], "no/where"),
    ],
)
def test_what_cannot_be_computed_or_written_is_refused_before_anything_is(
    path, options, said, tmp_path, monkeypatch
):
    from agglom_mpi.report import set_files

    monkeypatch.setattr(set_files, "FeasibleSet", None)
    monkeypatch.chdir(tmp_path)
    test_options_that_make_no_sense_are_told(path, options, said)
    assert list(tmp_path.iterdir()) == []


def test_a_wrong_number_leaves_no_page_behind(path, tmp_path):
    done = report(path, "--feasible-set", "--tolerance", "5", "--out", tmp_path / "page")
    assert done.exit_code == 2
    assert done.stderr.count("\n") == 1
    assert not (tmp_path / "page").exists()


def test_too_few_strings_are_one_line(tmp_path):
    path = three_variable_file(tmp_path, generations=2)
    done = report(path, "--feasible-set")
    assert done.exit_code == 2
    assert done.stderr.count("\n") == 1
    assert "at least 50 are needed" in done.stderr


def test_the_page_of_an_empty_set_shows_what_can_be_reached(path, tmp_path, monkeypatch):
    from agglom_mpi.inference.calibration import Calibration

    monkeypatch.setattr(Calibration, "passed", True)
    options = ["--tolerance", "1e-9", "--out", tmp_path / "page", "--stored-only"]
    done = report(path, "--feasible-set", *options)
    assert done.exit_code == 0, done.output
    page = (tmp_path / "page" / "report.html").read_text()
    outside_figures = re.sub(r"<svg.*?</svg>", "", page, flags=re.DOTALL)
    assert "share of the box" not in outside_figures
    assert (tmp_path / "page" / "set_reach.png").stat().st_size > 5000
    assert not (tmp_path / "page" / "set_pairs.png").exists()


def test_the_page_has_the_figures_of_the_set_and_the_table_beside_it(path, tmp_path):
    grid = tmp_path / "page" / "grid.csv"
    options = ["--out", tmp_path / "page", "--stored-only", "--grid", grid]
    options += ["--tolerance", "10%", "--measured", "2", "--error", "0.1"]
    done = report(path, "--feasible-set", *options)
    assert done.exit_code == 0, done.output
    assert grid.read_text().startswith("relative_speed (m/s),")
    page = (tmp_path / "page" / "report.html").read_text()
    assert "share of the box" in page
    for name in ("set_pairs", "set_group", "set_posterior"):
        assert (tmp_path / "page" / f"{name}.png").stat().st_size > 5000
        assert f"{name}.svg" in page
