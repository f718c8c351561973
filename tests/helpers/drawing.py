"""A pytest plugin: which tests draw random numbers, by themselves, by fixtures or by programs.

`--drawing FILE` writes their names, `--only FILE` leaves out all others: a pass with other random
numbers takes the tests whose outcome it could change.
"""

from pathlib import Path

import numpy as np
import pytest

_CALLS = [0]


def note_drawing():
    """Note that random numbers are drawn, or read from what was drawn."""
    _CALLS[0] += 1


def _noted(make):
    def noting(*arguments, **options):
        note_drawing()
        return make(*arguments, **options)

    return noting


class Drawing:
    """In a process that runs tests: adds to each report whether its test has drawn."""

    def __init__(self):
        from agglom_mpi import random_streams

        np.random.default_rng = _noted(np.random.default_rng)
        random_streams.generator = _noted(random_streams.generator)
        random_streams.key_words = _noted(random_streams.key_words)
        self._fixtures, self._files, self._before = set(), set(), 0

    @pytest.hookimpl(wrapper=True)
    def pytest_make_collect_report(self, collector):
        before = _CALLS[0]
        report = yield
        if _CALLS[0] > before and isinstance(collector, pytest.Module):
            self._files.add(collector.path)
        return report

    @pytest.hookimpl(wrapper=True)
    def pytest_fixture_setup(self, fixturedef):
        before = _CALLS[0]
        value = yield
        if _CALLS[0] > before:
            self._fixtures.add(fixturedef)
        return value

    @pytest.hookimpl(wrapper=True)
    def pytest_runtest_makereport(self, item):
        report = yield
        fixtures = (each for found in item._fixtureinfo.name2fixturedefs.values() for each in found)
        report.has_drawn = (
            _CALLS[0] > self._before
            or item.path in self._files
            or not self._fixtures.isdisjoint(fixtures)
            or "processes" in getattr(report, "core_seconds", {})
        )
        self._before = _CALLS[0]
        return report


class Selection:
    """In all processes: the tests to take; in the one that reports, the list to write."""

    def __init__(self, taken, written):
        self._taken = None if taken is None else set(Path(taken).read_text().splitlines())
        self._written, self._names = written, set()

    def pytest_collection_modifyitems(self, config, items):
        if self._taken is not None:
            left_out = [item for item in items if item.nodeid not in self._taken]
            config.hook.pytest_deselected(items=left_out)
            items[:] = [item for item in items if item.nodeid in self._taken]

    def pytest_runtest_logreport(self, report):
        if getattr(report, "has_drawn", False):
            self._names.add(report.nodeid)

    def pytest_sessionfinish(self):
        if self._written and self._names:
            Path(self._written).write_text("\n".join(sorted(self._names)) + "\n")
