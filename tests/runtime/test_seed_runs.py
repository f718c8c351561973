"""Runs with a seed on the command line: as with that seed in the file, into a file of its own."""

import re

from campaign_runs import TINY, assert_same, assert_sound, decisions, finish, invert, write_campaign

from agglom_mpi.config.campaign import Campaign
from agglom_mpi.storage.reader import read_campaign


def test_a_seed_of_the_command_line_is_one_of_the_file(tmp_path):
    text = write_campaign(tmp_path / "tiny.yaml", **TINY).read_text()
    without, count = re.subn(r"(?m)^seed: .*\n", "", text)
    assert count == 1
    (tmp_path / "tiny.yaml").write_text(without)
    finish(tmp_path, "tiny.yaml", "--seed", "3")
    finish(tmp_path, "tiny.yaml", "--seed", "5", "-o", "mine.h5")
    for seed, name in ((3, "tiny_seed3.h5"), (5, "mine_seed5.h5")):
        file = read_campaign(tmp_path / name)
        assert file.attributes["seed"] == Campaign.from_text(file.campaign_text).seed == seed
        assert_sound(tmp_path / name)
    assert not (tmp_path / "tiny.h5").exists()
    (tmp_path / "other.yaml").write_text(f"seed : 5\n{without}")
    finish(tmp_path, "other.yaml")
    assert_same(tmp_path / "mine_seed5.h5", decisions(tmp_path / "other.h5"))
    three, five = (read_campaign(tmp_path / f"{n}.h5") for n in ("tiny_seed3", "mine_seed5"))
    assert three.result_rows()["objective"].tolist() != five.result_rows()["objective"].tolist()


def test_a_resume_needs_the_same_seed(tmp_path):
    write_campaign(tmp_path / "tiny.yaml", **TINY)
    finish(tmp_path, "tiny.yaml", "--seed", "3")
    done = finish(tmp_path, "tiny.yaml", "--seed", "3")
    assert "tiny_seed3.h5 is finished already" in done.stdout + done.stderr
    before = (tmp_path / "tiny_seed3.h5").read_bytes()
    refused = invert(tmp_path, "tiny.yaml", "-o", "tiny_seed3.h5")
    assert refused.returncode == 2
    assert "tiny_seed3.h5: was made with seed 3, not 1; --seed 3 continues it" in refused.stderr
    assert (tmp_path / "tiny_seed3.h5").read_bytes() == before
    (tmp_path / "mine_seed4.h5").write_bytes(before)
    refused = invert(tmp_path, "tiny.yaml", "-o", "mine.h5", "--seed", "4")
    assert refused.returncode == 2
    assert "mine_seed4.h5: was made with seed 3, not 4" in refused.stderr
