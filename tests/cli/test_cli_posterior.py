"""The posterior of all measured data of a campaign, as commands show and write it."""

import json
import re

import pytest
from click.testing import CliRunner


@pytest.fixture
def run(measured_file, monkeypatch, remembered):
    """Return a function that runs a command on a campaign of few strings as if they sufficed."""
    monkeypatch.setattr("agglom_mpi.inference.stored_samples.MIN_STRINGS", 5)

    def run(command, *words):
        from agglom_mpi.cli import main

        return CliRunner().invoke(main, [command, str(measured_file), *map(str, words)])

    return run


def refuse(name):
    raise AssertionError(name)


def test_the_table_is_followed_by_the_posterior_and_its_verdict(run):
    done = run("report", "--posterior")
    assert done.exit_code == 0, done.output
    shown = done.stdout.partition("posterior, given all 3 measured data")[2]
    for name in ("relative_speed", "volume_fraction", "sizes", "particles left", "calibrat", "p ="):
        assert name in shown.replace("\n", " ") or name.replace(" ", "_") in shown


def test_json_of_a_posterior_has_ranges_data_and_verdict(run, tmp_path):
    done = run("report", "--posterior", "--json")
    assert done.exit_code == 0, done.output
    found = json.loads(done.stdout, parse_constant=refuse)["posterior"]
    assert set(found["variables"]) == set(found["contraction"]) == set(found["units"])
    assert len(found["data"]) == 3
    assert len(found["data"][0]["quantiles"][0]) == len(found["data"][0]["measured"]) == 3
    assert isinstance(found["calibration"]["calibrated"], bool)
    done = run("export", "--json", tmp_path / "p.json")
    assert done.exit_code == 0, done.output
    written = json.loads((tmp_path / "p.json").read_text(), parse_constant=refuse)["posterior"]
    assert written == found


def test_the_page_has_a_section_on_the_posterior(run, tmp_path):
    pytest.importorskip("matplotlib")
    pytest.importorskip("jinja2")
    done = run("report", "--posterior", "--stored-only", "--out", tmp_path)
    assert done.exit_code == 0, done.output
    page = (tmp_path / "report.html").read_text()
    assert 'id="posterior"' in page
    section = page.partition('<section id="posterior">')[2].partition("</section>")[0]
    assert "volume_fraction" in section
    for name in ("posterior_pairs", "predictive_check"):
        assert f'<figure id="{name}"' in section
        assert (tmp_path / f"{name}.png").stat().st_size > 5000
    identifiers = re.findall(r'\bid="([^"]*)"', page)
    assert len(identifiers) == len(set(identifiers))


def test_draws_for_arviz_are_of_the_posterior_of_all_data(run, tmp_path):
    xarray = pytest.importorskip("xarray")
    done = run("export", "--arviz", tmp_path / "p.nc")
    assert done.exit_code == 0, done.output
    with xarray.open_datatree(tmp_path / "p.nc", engine="h5netcdf") as tree:
        assert "calibrat" in tree.attrs["calibration"] or "claims" in tree.attrs["calibration"]
        assert tree["posterior/relative_speed"].attrs["units"] == "m/s"
        assert tree["observed_data/datum_0_sizes"].shape == (3,)
        assert tree["posterior_predictive/datum_0_sizes"].shape[-1] == 3


def test_a_campaign_without_data_is_refused_in_one_line(three):
    from agglom_mpi.cli import main

    done = CliRunner().invoke(main, ["report", str(three.path), "--posterior"])
    assert done.exit_code == 2
    assert "feasible_set" in done.stderr
    assert done.stdout == ""


def test_two_questions_at_once_need_a_page(run):
    done = run("report", "--posterior", "--feasible-set")
    assert done.exit_code == 2
    assert "--out" in done.stderr


def test_a_feasible_set_of_data_is_refused_with_what_there_is_instead(run):
    done = run("report", "--feasible-set")
    assert done.exit_code == 2
    assert "--posterior" in done.stderr


def test_a_tolerance_is_refused_where_the_posterior_of_data_is_written(run, tmp_path):
    done = run("export", "--json", tmp_path / "p.json", "--tolerance", "7%")
    assert done.exit_code == 2
    assert "--tolerance" in done.stderr
    assert list(tmp_path.iterdir()) == []
