"""`agglom export --xarray` and `--arviz`: files that other people's tools open."""

import importlib.util
import json
import os
import warnings

import numpy as np
import pytest
from click.testing import CliRunner

from agglom_mpi import open_campaign

xarray = pytest.importorskip("xarray")
pytestmark = pytest.mark.usefixtures("remembered")


def export(path, *arguments):
    from agglom_mpi.cli import main

    return CliRunner().invoke(main, ["export", str(path), *map(str, arguments)])


def test_padded_samples_have_the_means_of_the_table(agglom, tmp_path):
    done = agglom("export", "tiny.h5", "--xarray", tmp_path / "s.nc")
    assert done.exit_code == 0, done.stderr
    file = open_campaign("tiny.h5")
    with xarray.open_dataset(tmp_path / "s.nc", engine="h5netcdf") as found:
        assert found["mean_radius_ratio"].dims == ("string", "sample")
        assert int(found["present"].sum()) == len(file.samples)
        means = found["mean_radius_ratio"].mean("sample").to_numpy()
        expected = file.samples.groupby("string")["mean_radius_ratio"].mean()
        assert means == pytest.approx(expected.to_numpy(), rel=1e-12)
        assert found["string"].to_numpy().tolist() == expected.index.tolist()
        row = file.samples.iloc[-1]
        one = found.sel(string=row["string"], sample=row["sample"])
        assert float(one["seconds"]) == row["seconds"]
        assert str(one["state"].item()) == row["state"]
        results = found["string_objective"].to_numpy()
        assert np.array_equal(results, file.strings["objective"], equal_nan=True)
        assert found["hardness"].attrs["units"] == "Pa"
        assert (found.attrs["seed"], found.attrs["title"]) == (file.seed, file.title)
        assert found.attrs["campaign"] == file.campaign_text


def test_strings_with_fewer_samples_are_padded_with_nan(shared_campaign, tmp_path):
    path = shared_campaign("estimated") / "estimated.h5"
    assert export(path, "--xarray", tmp_path / "s.nc").exit_code == 0
    samples = open_campaign(path).samples
    samples = samples[samples["used"] | samples["fresh"]]  # without what ran ahead unused
    counts = samples.groupby("string").size()
    with xarray.open_dataset(tmp_path / "s.nc", engine="h5netcdf") as found:
        assert not bool(found["present"].all())
        assert found["present"].sum("sample").to_numpy().tolist() == counts.tolist()
        assert int(found["fresh"].sum()) == samples["fresh"].sum() > 0
        absent = ~found["present"].to_numpy().astype(bool)
        assert np.isnan(found["objective"].to_numpy()[absent]).all()
        assert set(found["state"].to_numpy()[absent]) == {"absent"}


def test_arviz_reads_and_draws_a_posterior(three, tmp_path):
    arviz = pytest.importorskip("arviz")
    matplotlib = pytest.importorskip("matplotlib")
    matplotlib.use("Agg")
    options = ["--arviz", tmp_path / "p.nc", "--measured", "2", "--error", "5%"]
    done = export(three.path, *options, "--tolerance", "10%")
    assert done.exit_code == 0, done.output
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        found = arviz.from_netcdf(tmp_path / "p.nc")
        axes = arviz.plot_posterior(found, var_names=["hardness"])
        arviz.plot_ppc(found, num_pp_samples=20)
    assert axes.lines
    assert float(found.observed_data["mean_radius_ratio"][0]) == 2.0
    assert found.constant_data["mean_radius_ratio_standard_error"].values == pytest.approx(0.1)
    with xarray.open_datatree(tmp_path / "p.nc", engine="h5netcdf") as tree:
        assert {"/posterior", "/prior", "/posterior_predictive"} < set(tree.groups)
        assert tree.attrs["seed"] == three.seed


def test_without_a_measured_mean_the_draws_are_members_of_the_set(three, tmp_path):
    assert export(three.path, "--arviz", tmp_path / "m.nc").exit_code == 0
    with xarray.open_datatree(tmp_path / "m.nc", engine="h5netcdf") as tree:
        assert "/observed_data" not in tree.groups
        probability = tree["sample_stats/probability"].to_numpy()
        assert probability.shape == tree["posterior/hardness"].shape
        assert 0.5 < probability.mean() <= 1.0
        assert "feasible set" in tree["posterior"].attrs["draws_are"]


@pytest.mark.parametrize("option", ["--xarray", "--arviz"])
def test_without_xarray_it_says_what_to_install(mistaken, tmp_path, monkeypatch, option):
    find = importlib.util.find_spec
    without = lambda name, *rest: None if name == "xarray" else find(name, *rest)  # noqa: E731
    monkeypatch.setattr(importlib.util, "find_spec", without)
    said = mistaken("export", "tiny.h5", option, tmp_path / "x.nc")
    assert said.endswith("need xarray: pip install 'agglom_mpi[arviz]'")
    assert os.listdir(tmp_path) == []


def test_options_that_make_no_sense_are_refused(agglom, tmp_path):
    for words in (
        ["--measured", "2", "--error", "1%", "--csv", tmp_path / "csv"],
        ["--arviz", tmp_path / "x.nc", "--measured", "2"],
        ["--arviz", tmp_path / "x.nc", "--xarray", tmp_path / "x.nc"],
    ):
        done = agglom("export", "tiny.h5", *words)
        assert done.exit_code == 2
        assert done.stderr
    assert os.listdir(tmp_path) == []


def test_nothing_is_overwritten(mistaken, tmp_path):
    (tmp_path / "x.nc").write_text("precious")
    said = mistaken("export", "tiny.h5", "--xarray", tmp_path / "x.nc", "--csv", tmp_path / "t")
    assert "x.nc" in said
    assert (tmp_path / "x.nc").read_text() == "precious"
    assert not (tmp_path / "t").exists()


def test_arrays_that_would_not_fit_into_memory_are_refused(mistaken, tmp_path, monkeypatch):
    monkeypatch.setattr("agglom_mpi.report.netcdf.MAX_CELLS", 10)
    assert "--csv" in mistaken("export", "tiny.h5", "--xarray", tmp_path / "x.nc")


def test_the_json_of_a_posterior_has_units_and_no_nan(three):
    from agglom_mpi.cli import main

    words = ["report", str(three.path), "--feasible-set", "--json", "--measured", "2"]
    done = CliRunner().invoke(main, [*words, "--error", "5%"])
    assert done.exit_code == 0, done.output

    def refuse(name):
        raise AssertionError(name)

    found = json.loads(done.stdout, parse_constant=refuse)["posterior"]
    assert found["units"] == {"relative_speed": "m/s", "hardness": "Pa", "friction": "1"}
    assert len(found["variables"]["hardness"]) == len(found["quantiles"])
