"""The published strings whose accuracy is reported."""

import re
import shlex
import subprocess
from pathlib import Path

import pytest
from campaign_runs import environment
from processes import HANG

from agglom_mpi.accuracy.soundness import KINDS
from agglom_mpi.config.loading import load_campaign

MAPS = sorted(Path("jobs/accuracy").glob("*_maps"))
PRINTED = r"(?m)^- [^:]+: (.*) of the plane; for example `(.*)`\.$"
SHOWN = {
    "unsolved impacts": r"capped_iterations +[1-9]",
    "below 0 K": r"floored_temperatures +[1-9]",
    "overlaps": r"overlaps +[1-9]",
    "budget exhausted": "budget of steps or events exceeded",
}
"""What a terminal shows of each kind of failure."""


@pytest.mark.parametrize("job", ["accretion_2003", "agglomeration_2004"])
def test_a_published_string_is_in_the_scene_of_its_job(job):
    alone, searched = (
        load_campaign(f"jobs/{name}.yaml") for name in (f"accuracy/{job}_row_1", job)
    )
    assert alone.scene == searched.scene
    assert alone.objective == searched.objective
    assert alone.seed == searched.seed
    values = alone.parameters()
    inside = (searched.variables.lower <= values) & (values <= searched.variables.upper)
    assert inside[: len(searched.variables.used)].all()


def printed_lines(maps):
    """Return the lines that stored maps print for their failing cells, by campaign file."""
    text = (maps / "report.md").read_text(encoding="utf-8")
    found = [(kinds, shlex.split(line)) for kinds, line in re.findall(PRINTED, text)]
    return {Path(words[2]).stem: (kinds, words) for kinds, words in found}


@pytest.mark.parametrize("maps", MAPS, ids=lambda maps: maps.name)
def test_every_printed_line_names_a_campaign_file_and_every_file_has_its_line(maps):
    lines = printed_lines(maps)
    assert lines
    assert set(lines) == {path.stem for path in (maps / "cells").glob("*.yaml")}
    for kinds, words in lines.values():
        assert load_campaign(words[2]).parameters().size
        assert any(kind in kinds for kind in SHOWN)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("maps", "cell"),
    [
        ("accretion_2003_maps", "softening_published_iteration"),
        ("accretion_2003_maps", "collapse_adaptive"),
        ("agglomeration_2004_maps", "heat_fixed_200_steps_euler_cooling"),
    ],
)
def test_a_failing_cell_is_reproduced_by_the_line_that_the_report_prints(maps, cell):
    kinds, words = printed_lines(Path("jobs/accuracy", maps))[cell]
    done = subprocess.run(
        words, env=environment(), capture_output=True, text=True, timeout=HANG, check=False
    )
    assert done.returncode == 0, done.stderr
    most_serious = min((kind for kind in SHOWN if kind in kinds), key=KINDS.index)
    assert re.search(SHOWN[most_serious], done.stdout + done.stderr), done.stdout
