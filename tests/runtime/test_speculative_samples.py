"""Files with samples of coming generations, and with samples that took too long, are sound."""

import numpy as np
from campaign_runs import (
    HANGS,
    HANGS_REPLACES,
    SMALL,
    TINY,
    assert_same,
    assert_sound,
    decisions,
    finish,
    injected,
    stop_here,
    write_campaign,
)

from agglom_mpi.storage.reader import read_campaign

AHEAD_FIRST = """
import agglom_mpi.scheduling.scheduler as scheduler

scheduler.URGENCY = 0.9  # announced strings come before those that decisions wait for
"""
URGENCY = "agglom_mpi.scheduling.scheduler.URGENCY"


def announced(path):
    """Strings of generations that have not begun: of those nothing is judged."""
    file = read_campaign(path)
    strings = file.string_rows()
    begun = len(file.generation_rows())
    return strings["string"][strings["generation"] > begun]


def test_a_file_that_holds_strings_of_coming_generations_is_sound(tmp_path):
    write_campaign(tmp_path / "small.yaml", **SMALL | {"generations": 2, "max_samples": 15})
    stop_here(tmp_path, "small", text=AHEAD_FIRST, replaced=[URGENCY])
    path = tmp_path / "small.h5"
    ahead = announced(path)
    assert len(ahead)
    assert np.isin(read_campaign(path).all_sample_rows()["string"], ahead).any()
    assert_sound(path)
    finish(tmp_path, "small.yaml", "-q")
    assert_sound(path)
    assert len(announced(path)) == 0
    finish(tmp_path, "small.yaml", "-q", "--output", "alone.h5")
    assert_same(path, decisions(tmp_path / "alone.h5"))


def test_strings_of_generations_that_a_reached_target_left_out_are_no_damage(tmp_path):
    path = write_campaign(tmp_path / "target.yaml", **SMALL | {"generations": 9})
    path.write_text(f"{path.read_text().rstrip()}\n  target: {{top: 1, objective: 100}}\n")
    with injected(AHEAD_FIRST, URGENCY):
        done = finish(tmp_path, "target.yaml")
    file = read_campaign(tmp_path / "target.h5")
    assert len(file.generation_rows()) == 1, done.stderr
    assert len(announced(tmp_path / "target.h5"))
    assert_sound(tmp_path / "target.h5")


def test_a_file_with_samples_that_took_too_long_is_sound(tmp_path):
    path = write_campaign(tmp_path / "late.yaml", **TINY)
    path.write_text(f"{path.read_text().rstrip()}\n  max_seconds: 1000 s\n")
    with injected(HANGS.replace("PAIRS", "{(0, 0), (2, 1)}"), *HANGS_REPLACES):
        done = finish(tmp_path, "late.yaml")
    assert "took longer than max_seconds, 1000 s" in done.stderr
    assert "finished already" in finish(tmp_path, "late.yaml").stderr
    file = read_campaign(tmp_path / "late.h5")
    assert len(file.failures()) == 2
    samples, results = file.all_sample_rows(), file.result_rows()
    pairs = set(samples[["string", "sample"]].tolist())
    assert pairs.isdisjoint(file.failures()[["string", "sample"]].tolist())
    assert int(np.sum(results["failed"])) == 2
    assert_sound(tmp_path / "late.h5")
