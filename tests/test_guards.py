"""Slow tests that name what guards the same more coarsely in the quick tier."""

import re
from pathlib import Path

TESTS = Path(__file__).parent
GUARD = re.compile(r'guard="([^"]+)"')


def test_every_guard_is_a_file_of_tests_and_a_test_in_it():
    guards = {guard for path in TESTS.rglob("*.py") for guard in GUARD.findall(path.read_text())}
    assert len(guards) > 20
    for guard in guards - {"([^"}:
        name, _, test = guard.partition("::")
        text = (TESTS / name).read_text()
        assert f"def {test or 'test_'}" in text, guard
