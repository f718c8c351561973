"""What a command does not need, it does not load."""

import json
import subprocess
import sys

import pytest
from campaign_runs import QUICKSTART, environment
from processes import HANG

HEAVY = {"numba", "h5py", "mpi4py", "pandas", "matplotlib"}
TEXTS = {"pint", "ruamel"}

STEPS = """
import contextlib, json, sys
for step in json.loads(sys.argv[1]):
    with contextlib.redirect_stdout(sys.stderr):
        if isinstance(step, str):
            exec(step)
        else:
            from agglom_mpi.cli import agglom
            sys.argv[1:] = step
            try: agglom()
            except SystemExit as end: assert not end.code, end.code
    print(json.dumps(sorted({name.split(".")[0] for name in sys.modules})))
"""


def loaded(*steps):
    """Top-level modules that are loaded after each of some steps in one fresh process.

    A step is some code, or the words of a command of `agglom`.
    """
    words = [step if isinstance(step, str) else [*map(str, step)] for step in steps]
    done = subprocess.run(
        [sys.executable, "-c", STEPS, json.dumps(words)],
        env=environment(),
        capture_output=True,
        text=True,
        timeout=HANG,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    return [set(json.loads(line)) for line in done.stdout.splitlines()]


def test_importing_the_package_and_looking_at_a_campaign_loads_no_heavy_library():
    imported, entered, *looked = loaded(
        "import agglom_mpi; dir(agglom_mpi)",
        "import agglom_mpi; agglom_mpi.load_campaign",
        ["--help"],
        ["report", "--help"],
        ["export", "--help"],
        ["check", QUICKSTART],
    )
    assert "agglom_mpi" in imported
    assert imported.isdisjoint({*HEAVY, "numpy", "click", "rich"})
    assert entered.isdisjoint(HEAVY)
    assert len(looked) == 4
    for modules in looked:
        assert modules.isdisjoint(HEAVY)


def test_what_reads_a_file_loads_hdf5_but_neither_simulator_nor_campaign_nor_tables(
    tiny_folder, tmp_path
):
    path = tiny_folder / "tiny.h5"
    for modules in loaded(
        "import agglom_mpi; agglom_mpi.open_campaign",
        ["report", path, "--json"],
        ["export", path, "--compact", tmp_path / "copy.h5"],
    ):
        assert "h5py" in modules
        assert modules.isdisjoint((HEAVY | TEXTS) - {"h5py"})


def test_a_table_loads_what_reads_the_units_of_the_campaign_and_nothing_heavier(tiny_folder):
    [modules] = loaded(["report", tiny_folder / "tiny.h5"])
    assert modules.isdisjoint((HEAVY | TEXTS) - {"h5py", "ruamel"})


def test_verifying_a_campaign_file_loads_hdf5_but_neither_simulator_nor_mpi(tiny_folder):
    [modules] = loaded(["check", tiny_folder / "tiny.h5"])
    assert "h5py" in modules
    assert modules.isdisjoint({*HEAVY, "rich"} - {"h5py"})


def test_simulating_a_campaign_loads_the_compiler_and_a_recorded_string_hdf5(tiny_folder):
    alone, recorded, planned = loaded(
        ["simulate", tiny_folder / "tiny.yaml", "--samples", "1"],
        ["simulate", tiny_folder / "tiny.h5", "--string", "1", "--samples", "1"],
        ["plan", tiny_folder / "tiny.yaml", "--ranks", "2", "--seconds", "0.1"],
    )
    assert "numba" in alone
    assert alone.isdisjoint({*HEAVY, "rich"} - {"numba"})
    assert {"numba", "h5py"} <= recorded
    assert recorded.isdisjoint(["mpi4py", "pandas", "matplotlib", "rich"])
    # Nor does a plan load MPI or anything of a report.
    assert planned.isdisjoint(["mpi4py", "pandas", "matplotlib"])


def test_an_unknown_name_is_not_in_the_package():
    import agglom_mpi

    with pytest.raises(AttributeError, match="has no attribute 'nonsense'"):
        agglom_mpi.nonsense  # noqa: B018
