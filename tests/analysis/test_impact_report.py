"""Reports of campaigns whose data are impacts alone, which laws predict without samples."""

from campaign_runs import finish
from click.testing import CliRunner

from agglom_mpi.cli import main

IMPACTS = """\
scene: {particles: 2, grain_radius: 1 mm, velocities: spread, heating: none, end_time: 1 us,
  restitution: constant}
variables:
  relative_speed: 1
  volume_fraction: 0.01
  density: 2500
  restitution.value: [0.5, 1]
data: [{quantity: restitution, file: i.csv, error: 0.02}]
objective: misfit
search: {method: random, population: 8}
ensemble: {rule: fixed, samples: 1}
stopping: {generations: 1}
final: none
"""


def test_a_report_of_impacts_speaks_of_no_luck_and_asks_for_no_collisions(tmp_path):
    (tmp_path / "i.csv").write_text("speed (m/s),radius (mm),coefficient\n1,1,0.7\n2,1,0.72\n")
    (tmp_path / "i.yaml").write_text(IMPACTS)
    finish(tmp_path, "i.yaml", "-q")
    done = CliRunner().invoke(main, ["report", str(tmp_path / "i.h5")])
    assert done.exit_code == 0
    assert "χ²" in done.stdout
    for word in ("lucky", "re-estimates", "no grain met", "did any grains bond"):
        assert word not in done.output
