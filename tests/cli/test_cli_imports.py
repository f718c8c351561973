"""What a command does not need, it does not load."""

import subprocess
import sys

import pytest
from farm_runs import QUICKSTART, environment

HEAVY = ["numba", "h5py", "mpi4py", "pandas", "matplotlib"]


def loaded(code, *arguments):
    """Top-level modules that are loaded after some code has run in a fresh process."""
    report = "import sys; print('loaded', *{name.split('.')[0] for name in sys.modules})"
    done = subprocess.run(
        [sys.executable, "-c", f"{code}\n{report}", *map(str, arguments)],
        env=environment(),
        capture_output=True,
        text=True,
        timeout=60,
        check=True,
    )
    return set(done.stdout.splitlines()[-1].split()[1:])


def test_importing_the_package_loads_nothing_else():
    modules = loaded("import agglom_mpi")
    assert "agglom_mpi" in modules
    assert modules.isdisjoint([*HEAVY, "numpy", "pydantic", "click", "rich"])


@pytest.mark.parametrize("arguments", [["check", QUICKSTART], ["report", "--help"], ["--help"]])
def test_looking_at_a_campaign_loads_no_heavy_library(arguments):
    code = (
        "from agglom_mpi.cli import main\ntry: main()\n"
        "except SystemExit as end: assert end.code == 0, end.code"
    )
    assert loaded(code, *arguments).isdisjoint(HEAVY)


def test_the_entry_points_are_loaded_when_they_are_used():
    modules = loaded("import agglom_mpi; agglom_mpi.load_campaign")
    assert modules.isdisjoint(HEAVY)
    assert "h5py" in loaded("import agglom_mpi; agglom_mpi.open_campaign")
    modules = loaded("import agglom_mpi; agglom_mpi.open_campaign")
    assert modules.isdisjoint(["mpi4py", "pandas", "matplotlib"])


def test_an_unknown_name_is_not_in_the_package():
    import agglom_mpi

    with pytest.raises(AttributeError, match="has no attribute 'nonsense'"):
        agglom_mpi.nonsense  # noqa: B018
