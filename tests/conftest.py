import pytest

RANKS = {"cluster", "crash", "farm", "mpi"}
"""Folders whose tests start ranks and watch the clock: one at a time."""


def pytest_addoption(parser):
    parser.addoption(
        "--many", type=int, metavar="N", help="Kills of each set-up of the crash harness."
    )


def has_ranks(nodeid):
    return nodeid.removeprefix("tests/").partition("/")[0] in RANKS


@pytest.hookimpl(optionalhook=True)  # pytest-xdist may be missing
def pytest_xdist_make_scheduler(config, log):
    """With `-n 2` a file stays on one core, and so do the tests with ranks: most, they begin."""
    from xdist.scheduler import LoadScopeScheduling

    class Together(LoadScopeScheduling):
        def _split_scope(self, nodeid):
            return "ranks" if has_ranks(nodeid) else nodeid.partition("::")[0]

    return Together(config, log)
