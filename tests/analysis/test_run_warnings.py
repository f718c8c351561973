"""What a finished run is warned of."""

import pytest
from campaign_runs import TINY, finish, write_campaign

from agglom_mpi.analysis import run_warnings
from agglom_mpi.storage.reader import read_campaign


@pytest.fixture(scope="module")
def path(tmp_path_factory):
    """Return the file of a campaign that searches the volume fraction."""
    folder = tmp_path_factory.mktemp("warned")
    campaign = write_campaign(folder / "warned.yaml", **TINY)
    text = campaign.read_text().replace("size_ratio: [0.4, 0.8]", "volume_fraction: [0.04, 0.2]")
    campaign.write_text(text)
    finish(folder, "warned.yaml", "-q")
    return folder / "warned.h5"


def test_the_edge_of_a_range_is_that_of_what_the_file_gives(path, monkeypatch):
    monkeypatch.setattr(run_warnings, "EDGE", 1.0)
    lines = run_warnings.run_warnings(read_campaign(path))
    [lower, upper] = [line for line in lines if line.startswith("variables.volume_fraction: is 0.")]
    assert "at the lower end of its range, 0.04 to 0.2; better ones may lie beyond" in lower
    assert "at the upper end of its range, 0.04 to 0.2; better ones may lie beyond" in upper


def test_a_target_that_was_not_reached_is_said(path, monkeypatch):
    monkeypatch.setattr(run_warnings, "MISS", -1.0)
    lines = run_warnings.run_warnings(read_campaign(path))
    assert any(line.startswith("objective: the best string misses its target") for line in lines)


def test_a_run_that_is_still_to_go_on_is_not_warned_of(path, tmp_path):
    campaign = write_campaign(tmp_path / "on.yaml", **TINY)
    finish(tmp_path, campaign.name, "-q")
    file = read_campaign(tmp_path / "on.h5")
    status = file.status()
    file.status = lambda: status._replace(state="stopped")
    assert run_warnings.run_warnings(file) == []


@pytest.mark.parametrize(("residual", "warned"), [(1e-9, 0), (1e-3, 1)])
def test_impacts_that_were_not_solved_are_counted(path, residual, warned):
    file = read_campaign(path)
    rows = file.all_sample_rows().copy()
    rows["largest_residual"][:2] = residual
    file.all_sample_rows = lambda: rows
    lines = [line for line in run_warnings.run_warnings(file) if line.startswith("scene.solver:")]
    assert len(lines) == warned
    assert all(f"in 2 of {len(rows)} completed samples" in line for line in lines)


def test_the_published_iteration_promises_no_root(path):
    file = read_campaign(path)
    rows = file.all_sample_rows().copy()
    rows["largest_residual"] = 0.5
    file.all_sample_rows = lambda: rows
    file.identity = {**file.identity, "scene.solver.law": "iteration"}
    lines = run_warnings.run_warnings(file)
    assert not [line for line in lines if line.startswith("scene.solver:")]
