import json
import subprocess
import sys

import h5py
import numpy as np
import pytest
from campaign_runs import environment, finish, inject, write_campaign
from perturbed_streams import VARIABLE, perturbation
from processes import HANG

from agglom_mpi.random_streams import RANDOM_STRING, sample_stream, search_stream
from agglom_mpi.version import __version__

SAMPLE_DRAW = "0x1.4bc7bf53463e2p-1"
COMMON_DRAW = "0x1.cb2d56de92b2ep-2"
SEARCH_DRAW = "0x1.781508ae0189cp-3"
"""First numbers of three streams, as every version draws them."""

DRAWS = """
import json
import sys

import numpy as np

import agglom_mpi
from agglom_mpi.random_streams import RANDOM_STRING, sample_stream, search_stream

string = np.arange(10.0)
streams = [
    sample_stream(1, string, 0),
    sample_stream(1, string, 0, common=True),
    search_stream(1, RANDOM_STRING, 0, 0),
    np.random.default_rng(1),
]
draws = [stream.random().hex() for stream in streams]
print(json.dumps([draws, agglom_mpi.__version__, getattr(sys, "injected", False)]))
"""


def drawn_by_program(inject=None, **variables):
    """First numbers of four streams, the version, and whether `sys.injected` is set."""
    done = subprocess.run(
        [sys.executable, "-c", DRAWS],
        env=environment(inject, **variables),
        capture_output=True,
        text=True,
        timeout=HANG,
        check=True,
    )
    return json.loads(done.stdout)


@pytest.mark.exact_bits
def test_keys_of_random_streams_stay_as_they_are():
    """Files of older versions are resumed: the same key gives the same numbers for ever."""
    string = np.arange(10.0)
    assert sample_stream(1, string, 0).random().hex() == SAMPLE_DRAW
    assert sample_stream(1, string, 0, common=True).random().hex() == COMMON_DRAW
    assert search_stream(1, RANDOM_STRING, 0, 0).random().hex() == SEARCH_DRAW


def test_programs_that_tests_start_draw_what_tests_draw():
    draws, version, _ = drawn_by_program()
    string = np.arange(10.0)
    assert draws[0] == sample_stream(1, string, 0).random().hex()
    assert draws[2] == search_stream(1, RANDOM_STRING, 0, 0).random().hex()
    assert draws[3] == np.random.default_rng(1).random().hex()
    assert version == __version__


@pytest.fixture
def perturbed(monkeypatch):
    """Return a function that sets what `--perturb K` sets for the programs that tests start."""

    def perturb(k):
        monkeypatch.setenv(VARIABLE, str(k))

    return perturb


def test_every_stream_depends_on_the_perturbation_and_the_version_names_it(perturbed, tmp_path):
    folder, found = inject(tmp_path / "injected", "import sys\nsys.injected = True\n"), []
    before, version = perturbation(), __version__.partition("+")[0]
    for k in (before + 1, before + 2, before + 1):
        perturbed(k)
        draws, named, injected = drawn_by_program(folder)
        assert named == f"{version}+perturbed.{k}"
        assert injected
        found.append(draws)
    assert found[0] == found[2]
    both = zip(found[0], found[1], strict=True)
    assert all(one != other for one, other in both)


@pytest.mark.slow(
    guard="test_random_streams.py::test_every_stream_depends_on_the_perturbation_and_the_version_names_it"
)
def test_a_perturbed_file_says_so(perturbed, tmp_path):
    k = perturbation() + 1
    perturbed(k)
    write_campaign(tmp_path / "tiny.yaml", generations=1, max_samples=5, population=4, parents=2)
    finish(tmp_path, "tiny.yaml", alone=True)
    with h5py.File(tmp_path / "tiny.h5") as file:
        assert str(file.attrs["code_version"]).endswith(f"+perturbed.{k}")
        assert file["legs"]["code_version"][0].decode().endswith(f"+perturbed.{k}")


def test_without_the_tests_switch_no_variable_changes_a_stream(monkeypatch):
    monkeypatch.setenv(VARIABLE, str(perturbation() + 1))
    variables = environment()
    del variables["PYTHONPATH"]
    words = [sys.executable, "-c", DRAWS]
    said = [
        subprocess.run(words, env=env, capture_output=True, text=True, timeout=HANG, check=True)
        for env in (variables, {k: v for k, v in variables.items() if k != VARIABLE})
    ]
    assert said[0].stdout == said[1].stdout
