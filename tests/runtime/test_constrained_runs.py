"""Runs of surrogate searches whose constraints allow little of the box."""

import pytest
from campaign_runs import assert_same, assert_sound, decisions, finish, state
from set_runs import three_variable_text

from agglom_mpi.analysis.file_check import check_file
from agglom_mpi.config.campaign import Campaign
from agglom_mpi.config.searchable import check_searchable
from agglom_mpi.emulation.blas_threads import single_threaded
from agglom_mpi.inference.feasible_set import FeasibleSet
from agglom_mpi.search import space
from agglom_mpi.storage.reader import read_campaign

AIMS = ("best", "set")


def text(aim, speed, stopping="{generations: 4}"):
    """Return a campaign whose slowest strings, up to a speed in m/s, are allowed alone."""
    return three_variable_text(
        search=f"{{method: surrogate, initial: 32, batch: 16, aim: {aim}}}",
        constraints=f'["relative_speed < {speed} m/s"]',
        stopping=stopping,
        final="none",
    )


def assert_runs(folder, aim, speed):
    (folder / "thin.yaml").write_text(text(aim, speed))
    finish(folder, "thin.yaml", "-q")
    assert "64 of 64 strings" in assert_sound(folder / "thin.h5")
    speeds = read_campaign(folder / "thin.h5").string_rows()["relative_speed"]
    assert len(set(speeds.tolist())) == 64
    assert speeds.max() < speed


@pytest.mark.parametrize("aim", AIMS)
def test_what_hardly_any_draw_satisfies_is_searched(tmp_path, monkeypatch, aim):
    """One draw in 250 is allowed: of 2¹⁶ that is too few for the candidates of either search."""
    monkeypatch.setattr(space, "MOST_DRAWS", 1 << 16)
    assert_runs(tmp_path, aim, 0.22)


@pytest.mark.slow
@pytest.mark.parametrize("aim", AIMS)
def test_what_check_accepts_is_searched(tmp_path, aim):
    """A 4000th of the box, as many draws as ever."""
    campaign = Campaign.from_text(text(aim, 0.1074))
    check_searchable(campaign)
    assert_runs(tmp_path, aim, 0.1074)
    finish(tmp_path, "thin.yaml", "-q", "-o", "legs.h5", "--generations", "3")
    finish(tmp_path, "thin.yaml", "-q", "-o", "legs.h5")
    assert_same(tmp_path / "legs.h5", decisions(tmp_path / "thin.h5"))


def test_the_error_of_a_thin_set_is_known_and_ends_its_search(tmp_path, monkeypatch):
    """Of 4096 even points two are allowed; strings that grow so little are no members."""
    monkeypatch.setattr(space, "MOST_DRAWS", 1 << 16)
    (tmp_path / "thin.yaml").write_text(
        text("set", 0.1074, "{generations: 12, expected_error: 0.5}").replace(
            "ratio: 2", "ratio: 1"
        )
    )
    finish(tmp_path, "thin.yaml", "-q")
    path = tmp_path / "thin.h5"
    assert state(path) == ("finished", "the expected error of the set is at most 0.5")
    found = single_threaded(FeasibleSet)(read_campaign(path), 0.05)
    assert found.allowed == pytest.approx(0.0074 / 29.9, rel=0.7)
    assert len(found.points.strings) >= 512
    assert found.points.weights.sum() == pytest.approx(1.0)
    assert found.volume > 0.9
    assert found.sample(20)["relative_speed"].max() < 0.1074


def test_a_replay_that_is_not_possible_is_one_line(tmp_path, monkeypatch):
    monkeypatch.setattr(space, "MOST_DRAWS", 1 << 16)
    (tmp_path / "thin.yaml").write_text(text("best", 0.22))
    finish(tmp_path, "thin.yaml", "-q")
    monkeypatch.setattr(space, "MOST_DRAWS", 0)
    said, code = check_file(str(tmp_path / "thin.h5"))
    assert code == 1
    assert "replay: not possible: no string of 0 satisfies the constraints" in said
