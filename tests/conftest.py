import os
import signal

# Two workers on two cores: more threads of a linear algebra library only wait for each other.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

from pathlib import Path

import pytest
from compile_once import share_compilations
from core_seconds import Bookkeeping, Measurement
from drawing import Drawing, Selection
from hypothesis import HealthCheck, settings
from leftovers import VARIABLE, Leftovers
from once import made_once, shared_folder
from perturbed_streams import perturb, perturbation, skip_exact_bits
from plain_python import mark_slow_if_compiled
from set_fixtures import (  # noqa: F401  (fixtures)
    doubling,
    filled,
    half,
    measured_file,
    three,
    unreachable,
)

# The same examples every time, and none that fails because the machine is busy.
settings.register_profile(
    "certain", deadline=None, derandomize=True, suppress_health_check=[HealthCheck.too_slow]
)
settings.load_profile("certain")


def pytest_addoption(parser):
    parser.addoption(
        "--many",
        type=int,
        metavar="N",
        help="Cases of each fuzzing test, and kills of each set-up of the crash harness.",
    )
    parser.addoption(
        "--perturb",
        type=int,
        metavar="K",
        help="Let all samples, searches and tests draw other random numbers, 1 to 1000.",
    )
    parser.addoption(
        "--core-seconds",
        metavar="TABLE",
        help="Write the processor time of each test file, by part, to a file.",
    )
    parser.addoption(
        "--budgets",
        metavar="TIER",
        help="Compare the processor time of each folder with tests/budget.toml: quick or slow.",
    )
    parser.addoption(
        "--drawing",
        metavar="FILE",
        help="Write the names of the tests that draw random numbers to a file.",
    )
    parser.addoption("--only", metavar="FILE", help="Take only the tests that a file names.")


def pytest_configure(config):
    """Perturb random streams; let the run, not its workers, fail if something is left behind."""
    if config.option.perturb or perturbation():
        perturb(config.option.perturb or perturbation())
    if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
        # Started in the background of a script: what tests start would inherit it.
        signal.signal(signal.SIGINT, signal.default_int_handler)
    if signal.getsignal(signal.SIGHUP) is signal.SIG_IGN:
        # Under nohup: what tests start would ignore it, which it does not where this handles it.
        signal.signal(signal.SIGHUP, lambda *_: None)
    config.pluginmanager.register(Drawing(), "drawing")
    config.pluginmanager.register(Measurement(), "measurement")
    workers = "PYTEST_XDIST_WORKER" in os.environ
    written = None if workers else config.option.drawing
    config.pluginmanager.register(Selection(config.option.only, written), "selection")
    if not workers:
        books = Bookkeeping(config.option.core_seconds, config.option.budgets)
        config.pluginmanager.register(books, "bookkeeping")
    if workers:
        share_compilations(Path(os.environ[VARIABLE]))
    elif not config.option.collectonly:
        config.pluginmanager.register(Leftovers(config.rootpath), "leftovers")


def pytest_report_header():
    return f"perturbed: {perturbation()}" if perturbation() else None


@pytest.hookimpl(tryfirst=True)
def pytest_collection_modifyitems(items):
    for item in items:
        if item.get_closest_marker("ranks"):
            item.add_marker("slow")
    mark_slow_if_compiled(items)
    skip_exact_bits(items)


@pytest.fixture(scope="session")
def shared_campaign(tmp_path_factory):
    """Return a function that gives the folder of a finished campaign that tests only read.

    See `SHARED` for the names. A folder has NAME.yaml and NAME.h5, made once in a test run.
    """
    from campaign_runs import SHARED, finish, write_campaign

    def folder_of(name):
        def make(folder):
            write_campaign(folder / f"{name}.yaml", **SHARED[name])
            finish(folder, f"{name}.yaml")

        return made_once(shared_folder(tmp_path_factory) / f"campaign-{name}", make)

    return folder_of


@pytest.fixture(scope="session")
def finished(shared_campaign):
    """Return the file of a finished campaign, six of its strings estimated again."""
    return shared_campaign("estimated") / "estimated.h5"
