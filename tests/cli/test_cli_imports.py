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


AGGLOM = (
    "from agglom_mpi.cli import agglom\ntry: agglom()\n"
    "except SystemExit as end: assert not end.code, end.code"
)


@pytest.mark.parametrize(
    "arguments",
    [["check", QUICKSTART], ["report", "--help"], ["export", "--help"], ["--help"]],
)
def test_looking_at_a_campaign_loads_no_heavy_library(arguments):
    assert loaded(AGGLOM, *arguments).isdisjoint(HEAVY)


@pytest.mark.parametrize("option", [[], ["--json"]])
def test_a_report_loads_hdf5_but_neither_simulator_nor_campaign_nor_tables(finished, option):
    modules = loaded(AGGLOM, "report", finished / "tiny.h5", *option)
    assert "h5py" in modules
    assert modules.isdisjoint({*HEAVY, "pydantic", "pint", "ruamel"} - {"h5py"})


def test_a_copy_loads_hdf5_but_neither_simulator_nor_campaign_nor_tables(finished, tmp_path):
    modules = loaded(AGGLOM, "export", finished / "tiny.h5", "--compact", tmp_path / "copy.h5")
    assert "h5py" in modules
    assert modules.isdisjoint({*HEAVY, "pydantic", "pint", "ruamel"} - {"h5py"})


def test_verifying_a_campaign_file_loads_hdf5_but_neither_simulator_nor_mpi(finished):
    modules = loaded(AGGLOM, "check", finished / "tiny.h5")
    assert "h5py" in modules
    assert modules.isdisjoint({*HEAVY, "rich"} - {"h5py"})


def test_simulating_a_campaign_loads_the_compiler_but_neither_hdf5_nor_mpi_nor_tables(finished):
    modules = loaded(AGGLOM, "simulate", finished / "tiny.yaml", "--samples", "1")
    assert "numba" in modules
    assert modules.isdisjoint({*HEAVY, "rich"} - {"numba"})


def test_a_plan_loads_no_mpi_and_from_a_file_no_compiler(finished):
    modules = loaded(AGGLOM, "plan", finished / "tiny.yaml", "--seconds", "0.5", "--ranks", "2")
    assert "numba" in modules
    assert modules.isdisjoint(["mpi4py", "pandas", "matplotlib"])
    source = ("--from", finished / "tiny.h5")
    modules = loaded(AGGLOM, "plan", finished / "tiny.yaml", *source, "--ranks", "2")
    assert "h5py" in modules
    assert modules.isdisjoint({*HEAVY} - {"h5py"})


def test_simulating_a_recorded_string_loads_hdf5(finished):
    modules = loaded(AGGLOM, "simulate", finished / "tiny.h5", "--string", "1", "--samples", "1")
    assert {"numba", "h5py"} <= modules
    assert modules.isdisjoint(["mpi4py", "pandas", "matplotlib", "rich"])


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
