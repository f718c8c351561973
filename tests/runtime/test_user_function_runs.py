"""A user's own objective on ranks: run when allowed, and never from a campaign file."""

import json
import os
import threading

import numpy as np
import psutil
import pytest
from campaign_runs import assert_same, decisions, finish, invert, state
from click.testing import CliRunner
from user_function_runs import WORTH, write_own

from agglom_mpi.accuracy.time_integration import search_history
from agglom_mpi.cli import main
from agglom_mpi.config.loading import load_campaign
from agglom_mpi.config.yaml_source import CampaignError
from agglom_mpi.outcome import COMPLETED, FAILED, FailureReason
from agglom_mpi.runtime.experiment import InversionExperiment
from agglom_mpi.runtime.task_runner import SampleRunner
from agglom_mpi.scheduling.interface import task_type
from agglom_mpi.storage.reader import read_campaign
from agglom_mpi.variables import TEN
from agglom_mpi.verbs.simulate import simulate


@pytest.fixture(scope="module")
def own(tmp_path_factory):
    """Return a folder with such a campaign and the file of its undisturbed run."""
    folder = tmp_path_factory.mktemp("own")
    write_own(folder, trace=folder / "trace")
    finish(folder, "own.yaml", "--allow-code")
    return folder


def forked_ending(end):
    """Return the exit code of a child of this process that ends in this way."""
    if not (child := os.fork()):
        end()
    return os.waitstatus_to_exitcode(os.waitpid(child, 0)[1])


@pytest.fixture
def agglom(own, monkeypatch):
    """Return a function that runs `agglom` in that folder, in this process."""
    monkeypatch.chdir(own)
    return lambda *arguments: CliRunner().invoke(main, [str(a) for a in arguments])


def simulated(campaign, samples=3, cut_short=False):
    """Return the batch that a rank makes of the first samples of the string in the middle.

    The first of them may be cut short, by a check that was meant for the sample before.
    """
    task = np.zeros(1, task_type(10))
    task["count"], task["parameters"] = samples, campaign.parameters()
    simulator = SampleRunner(InversionExperiment(campaign), 0)
    simulator.abort_flag.abort[0] = cut_short
    job = simulator.begin(task[0])
    while job.simulate_next():
        pass
    return job.collect()


def test_decisions_are_made_of_what_the_function_returned(own):
    file, campaign = read_campaign(own / "own.h5"), load_campaign(own / "own.yaml", True)
    results = file.result_rows()
    assert len(results) == 6
    for result in results[:3]:
        string = file.string_rows()[int(result["string"])]
        rows = file.sample_rows(int(result["string"]))[: result["samples_used"]]
        assert result["objective"] == pytest.approx(np.mean(rows["objective"]), rel=1e-12)
        error = np.std(rows["objective"], ddof=1) / np.sqrt(len(rows))
        assert result["standard_error"] == pytest.approx(error, rel=1e-9)
        outcome = simulate(campaign, np.array([string[name] for name in TEN.names]), 0)
        largest, size = outcome.radii.max(), string["size_ratio"]
        assert rows["objective"][0] == outcome.objective
        assert outcome.objective == largest / outcome.mean_radius_ratio - size


def test_without_leave_nothing_is_run_and_the_option_is_named(tmp_path):
    write_own(tmp_path, trace=tmp_path / "trace")
    done = invert(tmp_path, "own.yaml")
    assert done.returncode == 2
    assert done.stderr.count("\n") == 1
    assert "own.yaml:27: objective.call: is 'shape:worth', Python code" in done.stderr
    assert "--allow-code" in done.stderr
    assert sorted(path.name for path in tmp_path.iterdir()) == ["own.yaml", "shape.py"]


@pytest.mark.parametrize("command", ["simulate", "plan"])
def test_the_other_commands_ask_for_leave_too(agglom, own, command):
    before = (own / "trace").read_text()
    done = agglom(command, "own.yaml")
    assert done.exit_code == 2
    assert "--allow-code" in done.stderr
    done = agglom("accuracy", "own.yaml", "--quick", "--out", "study")
    assert done.exit_code == 2
    assert "--allow-code" in done.stderr
    assert (own / "trace").read_text() == before


@pytest.mark.parametrize(
    "arguments",
    [
        ("check", "own.h5"),
        ("check", "own.yaml"),
        ("report", "own.h5"),
        ("report", "own.h5", "--json"),
        ("export", "own.h5", "--csv", "tables"),
        ("export", "own.h5", "--compact", "small.h5"),
        ("simulate", "own.h5", "--string", 1, "--sample", 2),
        ("simulate", "own.h5", "--string", 1, "--allow-code", "--samples", 2),
    ],
)
def test_looking_at_a_campaign_or_its_file_runs_no_code(agglom, own, arguments):
    before = (own / "trace").read_text()
    source = (own / "shape.py").read_text()
    assert before
    if arguments[1] == "own.h5":
        (own / "shape.py").unlink()
    try:
        done = agglom(*arguments)
    finally:
        (own / "shape.py").write_text(source)
    assert done.exit_code == 0, done.output
    assert (own / "trace").read_text() == before


def test_a_check_decides_again_from_what_is_stored(agglom):
    said = agglom("check", "own.h5").stdout
    assert said.startswith("own.h5: sound")
    assert "6 of 6 results and 2 of 2 populations" in said


def test_a_replayed_sample_is_shown_without_its_objective(agglom):
    text = agglom("simulate", "own.h5", "--string", 1, "--sample", 2).stdout
    lines = text.splitlines()
    assert lines[-2:] == [
        "objective left out: a function is never run from a campaign file",
        "identical to the recorded sample",
    ]
    assert next(line for line in lines if "objective " in line).split() == [
        "objective",
        "no",
        "result",
    ]
    report = json.loads(agglom("simulate", "own.h5", "--string", 1, "--json").stdout)
    assert report["objective"] == {"mean": None, "standard_error": None}


def test_a_forward_run_shows_the_mean_of_the_function(agglom, own):
    done = agglom("simulate", "own.yaml", "--allow-code", "--samples", 4, "--json")
    campaign = load_campaign(own / "own.yaml", allow_code=True)
    alone = [simulate(campaign, {}, sample).objective for sample in range(4)]
    objective = json.loads(done.stdout)["objective"]
    assert objective["mean"] == pytest.approx(np.mean(alone), rel=1e-12)
    error = np.std(alone, ddof=1) / 2
    assert objective["standard_error"] == pytest.approx(error, rel=1e-9)


def test_a_forecast_takes_the_samples_of_the_same_function_only(agglom, own):
    arguments = ("plan", "own.yaml", "--allow-code", "--from", "own.h5", "--ranks", "1", "--json")
    assert json.loads(agglom(*arguments).stdout)["forecasts"][0]["used"] > 0
    source = (own / "shape.py").read_text()
    (own / "shape.py").write_text(source + "# changed\n")
    try:
        done = agglom(*arguments)
    finally:
        (own / "shape.py").write_text(source)
    assert done.exit_code == 2
    assert "own.h5: objective.call: " in done.stderr


def test_strings_are_estimated_again_with_the_unchanged_function_only(own):
    history = read_campaign(own / "own.h5")
    code = load_campaign(own / "own.yaml", allow_code=True).user_function
    setups = search_history.history_part(history, 5, code).setups
    assert all(setup.campaign.user_function == code for setup in setups.values())
    for other in (None, code._replace(module=code.module._replace(sha256="0" * 64))):
        with pytest.raises(CampaignError, match="a function that is not run from a file: give"):
            search_history.history_part(history, 5, other)


def test_a_resume_with_the_same_source_ends_as_one_run_does(own, tmp_path):
    write_own(tmp_path, trace=own / "trace")
    finish(tmp_path, "own.yaml", "--allow-code", "--generations", "1")
    assert len(read_campaign(tmp_path / "own.h5").generation_rows()) == 1
    finish(tmp_path, "own.yaml", "--allow-code")
    assert_same(tmp_path / "own.h5", decisions(own / "own.h5"))

    (tmp_path / "shape.py").write_text((tmp_path / "shape.py").read_text() + "# changed\n")
    before = (tmp_path / "own.h5").read_bytes()
    done = invert(tmp_path, "own.yaml", "--allow-code")
    assert done.returncode == 2
    assert "own.h5: belongs to another campaign" in done.stderr
    assert "objective.source_sha256: " in done.stderr
    assert "  objective.call" not in done.stderr
    assert (tmp_path / "own.h5").read_bytes() == before


FAULTS = [
    ("raise ValueError('no such thing')", "ValueError: no such thing"),
    ("return float('nan')", "shape:worth returned nan; must be finite"),
    ("return '7'", "shape:worth returned '7', of type str; must be a number"),
    ("sample.radii[0] = 0.0; return 1.0", "read-only"),
]


@pytest.mark.parametrize(("fault", "said"), FAULTS)
def test_a_function_that_fails_makes_a_failed_sample_with_its_text(tmp_path, fault, said):
    # Sample by sample: the others complete.
    source = f"seen = []\ndef worth(sample):\n    seen.append(0)\n    if len(seen) == 2: {fault}\n"
    path = write_own(tmp_path, f"{source}    return 0.5\n")
    batch = simulated(load_campaign(path, allow_code=True))
    rows = batch.results
    assert rows["state"].tolist() == [COMPLETED, FAILED, COMPLETED]
    assert rows["reason"].tolist() == [0, FailureReason.EXCEPTION, 0]
    assert rows["objective"].tolist() == [0.5, 0.0, 0.5]
    [failure] = batch.failures
    text = failure["text"].decode()
    assert failure["sample"] == 1
    assert said in text
    assert "shape.py" in text or "must be" in text


HOSTILE = """
import os, posix, sys
from os import _exit as ending

class Stranger:
    @property
    def __class__(self):
        raise SystemExit(0)

class Number(float):
    def __float__(self):
        raise SystemExit(0)

class Shy(ValueError):
    def __str__(self):
        raise SystemExit(0)

class Bare(BaseException):
    pass

owner, seen = os.getpid(), []

def worth(sample):
    seen.append(0)
    if len(seen) == 2: FAULT
    return 0.5
"""
ENDINGS = [
    (r"raise ValueError('\udc80 and \ud800')", r"ValueError: \udc80 and \ud800"),
    ("raise Shy", "Shy: <exception str() failed>"),
    ("raise Bare('me')", "shape:worth raised Bare, which would end a rank"),
    ("raise KeyboardInterrupt", "shape:worth raised KeyboardInterrupt"),
    ("raise GeneratorExit", "shape:worth raised GeneratorExit"),
    ("raise StopIteration", "StopIteration"),
    ("raise EOFError", "EOFError"),
    ("sys.exit()", "shape:worth raised SystemExit"),
    ("return Number(1.0)", "shape:worth raised SystemExit"),
    ("return Stranger()", "shape:worth raised SystemExit"),
    ("os._exit(0)", "os._exit would end a rank"),
    ("posix._exit(0)", "os._exit would end a rank"),
    ("ending(0)", "os._exit would end a rank"),
    ("os.execl('/bin/true', 'true')", "os.execv would end a rank"),
    ("os.execvpe('true', ['true'], {})", "os.execve would end a rank"),
]


@pytest.mark.parametrize(("fault", "said"), ENDINGS)
def test_a_function_that_would_end_the_process_makes_a_failed_sample(tmp_path, fault, said):
    path = write_own(tmp_path, HOSTILE.replace("FAULT", fault))
    campaign = load_campaign(path, allow_code=True)
    done = []
    # As in a run: not in the main thread, which a Ctrl-C may interrupt.
    thread = threading.Thread(target=lambda: done.append(simulated(campaign)))
    thread.start()
    thread.join()
    [batch] = done
    assert batch.results["state"].tolist() == [COMPLETED, FAILED, COMPLETED]
    assert batch.results["objective"].tolist() == [0.5, 0.0, 0.5]
    [failure] = batch.failures
    assert said in failure["text"].decode()


@pytest.mark.parametrize("ending", ["return 1.0", "raise ValueError", "sys.exit(0)"])
def test_a_process_that_the_function_forks_is_no_second_rank(tmp_path, ending):
    note = tmp_path / "child"
    fork = f"""
        if not os.fork():
            open({str(note)!r}, 'w').write(str(os.getpid()))
            {ending}
        os.wait()
    """
    path = write_own(tmp_path, HOSTILE.replace("FAULT", fork.rstrip()))
    batch = simulated(load_campaign(path, allow_code=True))
    assert batch.results["objective"].tolist() == [0.5] * 3
    assert not psutil.pid_exists(int(note.read_text()))


def test_a_process_that_the_function_forks_may_end_itself(tmp_path):
    fork = """
        if not (child := os.fork()):
            os.execl('/bin/sh', 'sh', '-c', 'exit 7')
        if not (other := os.fork()):
            os._exit(8)
        ended = [os.waitstatus_to_exitcode(os.waitpid(each, 0)[1]) for each in (child, other)]
        return float(ended[0] + 10 * ended[1])
    """
    path = write_own(tmp_path, HOSTILE.replace("FAULT", fork.rstrip()))
    batch = simulated(load_campaign(path, allow_code=True))
    assert batch.results["objective"].tolist() == [0.5, 87.0, 0.5]


def test_outside_of_the_function_these_calls_are_as_ever(tmp_path):
    path = write_own(tmp_path)
    simulated(load_campaign(path, allow_code=True), samples=1)
    assert forked_ending(lambda: os._exit(9)) == 9
    assert forked_ending(lambda: os.execv("/bin/false", ["false"])) == 1


@pytest.mark.parametrize("ending", ["os._exit(0)", "sys.exit()", "raise Bare", "raise Shy"])
def test_a_module_that_would_end_the_process_is_one_message(tmp_path, ending):
    path = write_own(tmp_path, f"{HOSTILE.replace('FAULT', 'pass')}\n{ending}\n")
    with pytest.raises(CampaignError, match=r"own.yaml:27: objective.call: is 'shape:worth', but"):
        load_campaign(path, allow_code=True)


ENDS = pytest.mark.slow(
    guard="runtime/test_user_function_runs.py"
    "::test_a_function_that_would_end_the_process_makes_a_failed_sample"
)


@pytest.mark.parametrize(
    "fault", [pytest.param("os._exit(0)", marks=ENDS), r"raise ValueError('\udc80')"]
)
def test_a_run_whose_function_would_end_it_fails_in_words(tmp_path, fault):
    source = f"import os\ndef worth(sample):\n    {fault}\n"
    write_own(tmp_path, source, max_failures=3)
    done = invert(tmp_path, "own.yaml", "--allow-code", alone="_exit" in fault)
    assert done.returncode == 1
    assert "samples failed with errors" in done.stderr
    assert state(tmp_path / "own.h5")[0] == "failed"


COUNTS = "seen = []\ndef worth(sample):\n    seen.append(0)\n    return float(len(seen))\n"


def test_a_sample_that_is_cut_short_and_done_again_is_shown_to_the_function_once(tmp_path):
    path = write_own(tmp_path, f"{COUNTS}# done again")
    rows = simulated(load_campaign(path, allow_code=True), cut_short=True).results
    assert rows["objective"].tolist() == [1.0, 2.0, 3.0]


def test_a_sample_that_took_too_long_has_no_objective(tmp_path):
    path = write_own(tmp_path, f"{COUNTS}# too long")
    path.write_text(path.read_text().rstrip() + "\n  max_seconds: 1e-9\n")
    rows = simulated(load_campaign(path, allow_code=True)).results
    assert rows["reason"].tolist() == [FailureReason.TIMED_OUT] * 3
    assert rows["objective"].tolist() == [0.0] * 3


def test_too_many_failures_of_the_function_end_the_run(tmp_path):
    source = "def worth(sample):\n    return sample.mean_radius_ratio / 0\n"
    write_own(tmp_path, source, max_failures=3)
    done = invert(tmp_path, "own.yaml", "--allow-code")
    assert done.returncode == 1
    assert "return sample.mean_radius_ratio / 0" in done.stderr
    assert "ZeroDivisionError: float division by zero" in done.stderr
    assert "samples failed with errors" in done.stderr


def test_the_function_sees_what_is_stored_of_the_sample(tmp_path):
    source = """
import numpy as np
def worth(sample):
    mean, second, third, fourth = sample.moments
    assert mean == sample.mean_radius_ratio
    assert np.isclose(sample.radii.mean(), mean, rtol=1e-12)
    assert np.isclose(sample.radii.var(), second, rtol=1e-9)
    assert sample.grains.sum() == 100 and sample.temperatures.shape == (sample.particles,)
    assert sample.merges == 100 - sample.particles and sample.breakups == 0
    assert sample.collisions >= sample.merges and sample.end_time > 0.0
    assert "surface_energy" not in sample.parameters and sample.parameters["density"] == 6142.0
    return float(sample.collisions)
"""
    batch = simulated(load_campaign(write_own(tmp_path, source), allow_code=True))
    rows = batch.results
    assert rows["state"].tolist() == [COMPLETED] * 3
    assert rows["objective"].tolist() == rows["collisions"].tolist()


def test_a_sample_of_another_objective_is_not_copied(tmp_path, monkeypatch):
    import agglom_mpi.runtime.task_runner as simulator

    path = write_own(tmp_path, WORTH)
    text = path.read_text().replace("{law: function, call: 'shape:worth'}", "maximum_growth")
    path.write_text(text)
    monkeypatch.setattr(simulator, "final_particles", None)
    rows = simulated(load_campaign(path)).results
    assert rows["state"].tolist() == [COMPLETED] * 3


def test_particles_are_stored_as_they_were_beside_a_function(tmp_path):
    path = write_own(tmp_path)
    plain = simulated(load_campaign(path, allow_code=True)).results
    path.write_text(path.read_text() + "\noutput: {final_particles: true}\n")
    batch = simulated(load_campaign(path, allow_code=True))
    assert batch.results["objective"].tobytes() == plain["objective"].tobytes()
    for row, worth in zip(batch.final_particles, plain["objective"], strict=True):
        radii = row["radius"][: int(row["particles"])]
        size = load_campaign(path, allow_code=True).parameters()[TEN.names.index("size_ratio")]
        # The function divides b/b0, the file holds b: each rounds once.
        assert worth == pytest.approx(radii.max() / radii.mean() - size, rel=1e-13)


def test_moments_are_searched_and_checked_like_any_objective(tmp_path):
    path = write_own(tmp_path)
    law = "{law: moments, targets: {mean: 2, spread: 0.5, skewness: 0}, weights: {mean: 3}}"
    path.write_text(path.read_text().replace("{law: function, call: 'shape:worth'}", law))
    finish(tmp_path, "own.yaml")
    done = CliRunner().invoke(main, ["check", str(tmp_path / "own.h5")])
    assert done.exit_code == 0, done.output
    file = read_campaign(tmp_path / "own.h5")
    outcome = simulate(
        load_campaign(path), np.array([file.string_rows()[0][name] for name in TEN.names]), 0
    )
    mean, second, third, _ = outcome.moments
    skewness = third / second**1.5
    wanted = 3 * abs(mean / 2 - 1) + abs(np.sqrt(second) / 0.5 - 1) + abs(skewness)
    assert outcome.objective == pytest.approx(wanted, rel=1e-12)
    assert file.sample_rows(0)["objective"][0] == outcome.objective
