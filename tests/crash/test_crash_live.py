"""Readers of a file that another job is writing see whole rows, and ever more of them."""

import itertools
import signal
import subprocess
import time

import pytest
from farm_runs import (
    SLOW,
    assert_same,
    environment,
    need_mpirun,
    running,
    state,
    wait_until,
    write_campaign,
)

from agglom_mpi.database.reader import open_campaign
from agglom_mpi.report.summary import summarise

PERIOD = 0.1


def look(path):
    """Number of final rows of each table, after reading all that reports and people read."""
    campaign = open_campaign(path)
    summarise(campaign)
    counts = [len(campaign.generations), len(campaign.strings), len(campaign.samples)]
    judged = campaign.strings
    judged = judged[judged["samples_used"] > 0]
    assert judged["objective"].notna().all()
    assert set(judged["generation"]) <= set(range(campaign.attributes["strings"]))
    assert campaign.damaged == 0
    return counts


@pytest.mark.parametrize("ranks", [None, 2])
def test_a_reader_polling_ten_times_a_second_never_fails(tmp_path, folder, wanted, ranks):
    if ranks is not None:
        need_mpirun()
    path = tmp_path / "slow.h5"
    seen = []
    with running(folder, "slow.yaml", ranks=ranks) as process:
        wait_until(path.exists, process)
        while process.poll() is None:
            begin = time.monotonic()
            seen.append(look(path))
            time.sleep(max(0.0, begin + PERIOD - time.monotonic()))
        said = process.communicate(timeout=30)
    assert process.returncode == 0, said
    assert len(seen) >= 5
    for earlier, later in itertools.pairwise(seen):
        assert all(a <= b for a, b in zip(earlier, later, strict=True))
    assert any(0 < counts[2] < look(path)[2] for counts in seen), "nothing was seen half done"
    assert_same(path, wanted)


def test_report_and_export_work_while_a_run_goes_on(tmp_path):
    write_campaign(tmp_path / "long.yaml", **SLOW | {"steps": 20_000})

    def agglom(*words):
        return subprocess.run(
            ["agglom", *words],
            cwd=tmp_path,
            env=environment(),
            capture_output=True,
            text=True,
            timeout=60,
            check=True,
        )

    with running(tmp_path, "long.yaml") as process:
        path = tmp_path / "long.h5"
        wait_until(lambda: path.exists() and len(open_campaign(path).result_rows()) > 0, process)
        report = agglom("report", "long.h5").stdout
        agglom("export", "long.h5", "--compact", "copy.h5")
        assert "running" in report
        assert process.poll() is None, "the run was over too soon to be watched"
        process.send_signal(signal.SIGTERM)
        process.communicate(timeout=30)
        assert process.returncode == 75
    copy = open_campaign(tmp_path / "copy.h5")
    assert 0 < len(copy.all_sample_rows()) <= len(open_campaign(path).all_sample_rows())
    assert state(path)[0] == "stopped"
