"""Files with samples of coming generations, and with samples that took too long, are sound."""

import numpy as np
from farm_runs import (
    SLOW,
    SMALL,
    TINY,
    assert_same,
    assert_sound,
    decisions,
    finish,
    inject,
    stop,
    write_campaign,
)

from agglom_mpi.database.reader import open_campaign

AHEAD_FIRST = """
import agglom_mpi.farm.scheduler as scheduler

scheduler.URGENCY = 0.9  # announced strings come before those that decisions wait for
"""

ONE_TOOK_TOO_LONG = """
import numpy as np
import agglom_mpi.farm.simulator as simulator

simulate_scene = simulator.simulate_scene
late = []

def slow(scene, random, abort, frames=None):
    if not abort[0] and len(late) < 2:
        late.append(True)
        import time
        time.sleep(1.5)
    return simulate_scene(scene, random, abort, frames)

simulator.simulate_scene = slow
"""


def announced(path):
    """Strings of generations that have not begun: of those nothing is judged."""
    file = open_campaign(path)
    strings = file.string_rows()
    begun = len(file.generation_rows())
    return strings["string"][strings["generation"] > begun]


def test_a_file_that_holds_strings_of_coming_generations_is_sound(tmp_path):
    write_campaign(tmp_path / "slow.yaml", **SLOW | {"generations": 2, "max_samples": 15})
    folder = inject(tmp_path / "inject", AHEAD_FIRST)
    code, errors = stop(tmp_path, "slow", inject=folder)
    assert code == 75, errors
    path = tmp_path / "slow.h5"
    ahead = announced(path)
    assert len(ahead)
    assert np.isin(open_campaign(path).all_sample_rows()["string"], ahead).any()
    assert_sound(path)
    finish(tmp_path, "slow.yaml", "-q")
    assert_sound(path)
    assert len(announced(path)) == 0
    finish(tmp_path, "slow.yaml", "-q", "--output", "alone.h5")
    assert_same(path, decisions(tmp_path / "alone.h5"))


def test_strings_of_generations_that_a_reached_target_left_out_are_no_damage(tmp_path):
    path = write_campaign(tmp_path / "target.yaml", **SMALL | {"generations": 9})
    path.write_text(f"{path.read_text().rstrip()}\n  target: {{top: 1, objective: 100}}\n")
    done = finish(tmp_path, "target.yaml", inject=inject(tmp_path / "inject", AHEAD_FIRST))
    file = open_campaign(tmp_path / "target.h5")
    assert len(file.generation_rows()) == 1, done.stderr
    assert len(announced(tmp_path / "target.h5"))
    assert_sound(tmp_path / "target.h5")


def test_a_file_with_samples_that_took_too_long_is_sound(tmp_path):
    path = write_campaign(tmp_path / "late.yaml", **TINY)
    path.write_text(f"{path.read_text().rstrip()}\n  max_seconds: 1 s\n")
    done = finish(tmp_path, "late.yaml", inject=inject(tmp_path / "inject", ONE_TOOK_TOO_LONG))
    assert "took longer than max_seconds, 1 s" in done.stderr
    assert "finished already" in finish(tmp_path, "late.yaml").stderr
    file = open_campaign(tmp_path / "late.h5")
    assert len(file.failures()) == 2
    samples, results = file.all_sample_rows(), file.result_rows()
    pairs = set(samples[["string", "sample"]].tolist())
    assert pairs.isdisjoint(file.failures()[["string", "sample"]].tolist())
    assert int(np.sum(results["failed"])) == 2
    assert_sound(tmp_path / "late.h5")
