"""Campaigns that search numbers of their scene, on several ranks."""

import pytest
from campaign_runs import assert_same, assert_sound, decisions, finish, need_mpirun, stop
from path_campaigns import SIZED

from agglom_mpi.storage.reader import read_campaign


@pytest.fixture(scope="module")
def alone(tmp_path_factory):
    """Return the folder of a campaign and the file of its run on one rank."""
    folder = tmp_path_factory.mktemp("paths")
    (folder / "sized.yaml").write_text(SIZED)
    finish(folder, "sized.yaml", "-q")
    return folder


@pytest.mark.ranks(guard="runtime/test_path_runs.py")
def test_three_ranks_stopped_and_resumed_decide_the_same(alone, tmp_path):
    need_mpirun()
    (tmp_path / "sized.yaml").write_text(SIZED)
    code, said = stop(tmp_path, "sized", ranks=3)
    assert code == 75, said
    assert_sound(tmp_path / "sized.h5")
    finish(tmp_path, "sized.yaml", "-q", ranks=3)
    assert_same(tmp_path / "sized.h5", decisions(alone / "sized.h5"))
    file = read_campaign(tmp_path / "sized.h5")
    assert set(file.all_sample_rows()["rank"]) == {0, 1, 2}
    assert file.variables.further_names[-1] == "volume_fraction"
