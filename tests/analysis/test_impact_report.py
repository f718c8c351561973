"""Reports of campaigns whose data are impacts alone, which laws predict without samples."""

import shutil
from pathlib import Path

from campaign_runs import finish
from click.testing import CliRunner

from agglom_mpi.cli import main

JOBS = Path(__file__).parents[2] / "jobs/impacts"


def test_a_report_of_impacts_speaks_of_no_luck_and_asks_for_no_collisions(tmp_path):
    for name in ("croquet_ball.yaml", "croquet_ball.csv"):
        shutil.copy(JOBS / name, tmp_path)
    finish(tmp_path, "croquet_ball.yaml", "-q")
    done = CliRunner().invoke(main, ["report", str(tmp_path / "croquet_ball.h5")])
    assert done.exit_code == 0
    assert "χ²" in done.stdout
    for word in ("lucky", "re-estimates", "no grain met", "did any grains bond"):
        assert word not in done.output
