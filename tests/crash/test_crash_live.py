"""Readers of a file that another job is writing see whole rows, and ever more of them."""

import itertools
import signal

import pytest
from campaign_runs import assert_same, invert, need_mpirun, running, samples_in, state, wait_until
from click.testing import CliRunner
from held_runs import allow, allow_all, held
from processes import output_of

from agglom_mpi.analysis.summary import summary_table
from agglom_mpi.campaign_file import open_campaign
from agglom_mpi.cli import main
from agglom_mpi.storage.reader import read_campaign


def look(path):
    """Number of final rows of each table, after reading all that reports and people read."""
    campaign = open_campaign(path)
    summary_table(read_campaign(path))
    counts = [len(campaign.generations), len(campaign.strings), len(campaign.samples)]
    judged = campaign.strings
    judged = judged[judged["samples_used"] > 0]
    assert judged["objective"].notna().all()
    assert set(judged["generation"]) <= set(range(read_campaign(path).attributes["strings"]))
    assert campaign.damaged == 0
    return counts


@pytest.mark.slow
def test_a_reader_that_looks_all_the_time_never_fails(folder, wanted):
    need_mpirun()
    path, seen = folder / "small.h5", []

    def looked(enough):
        seen.append(look(path))
        return seen[-1][2] >= enough

    allow(folder, 10)
    with running(folder, "small.yaml", ranks=2, inject=held(folder)) as process:
        wait_until(lambda: samples_in(path) > 0, process)
        for enough in (100, 200, 300):
            allow(folder, enough)
            wait_until(lambda enough=enough: looked(enough), process)
        allow_all(folder)
        while process.poll() is None:
            seen.append(look(path))
        said = output_of(process)
    assert process.returncode == 0, said
    assert len(seen) >= 3
    for earlier, later in itertools.pairwise(seen):
        assert all(a <= b for a, b in zip(earlier, later, strict=True))
    assert any(0 < counts[2] < look(path)[2] for counts in seen), "nothing was seen half done"
    assert_same(path, wanted)


def test_report_and_export_work_while_a_run_goes_on_and_a_second_run_is_refused(folder):
    def agglom(*words):
        done = CliRunner().invoke(main, list(map(str, words)))
        assert done.exit_code == 0, done.stderr
        return done.stdout

    path, copied = folder / "small.h5", folder / "copy.h5"
    allow(folder, 300)
    with running(folder, "small.yaml", inject=held(folder)) as process:
        wait_until(lambda: path.exists() and len(read_campaign(path).result_rows()) > 0, process)
        assert "running" in agglom("report", path)
        agglom("export", path, "--compact", copied)
        done = invert(folder, "small.yaml")
        assert done.returncode == 2
        assert f"in use by process {process.pid} on " in done.stderr
        assert done.stderr.count("\n") == 1
        process.send_signal(signal.SIGTERM)
        output_of(process)
        assert process.returncode == 75
    copy = read_campaign(copied)
    assert 0 < len(copy.all_sample_rows()) <= len(read_campaign(path).all_sample_rows())
    assert state(path)[0] == "stopped"
