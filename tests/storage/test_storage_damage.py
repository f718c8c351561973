"""Damage to what HDF5 keeps for itself, which no checksum covers."""

import errno
import json
import signal
import sys

import flipped_bits
import h5py
import numpy as np
import pytest
from flipped_bits import REFUSED, SOUND
from processes import output_of, program
from storage_rows import make, put_strings, sample_rows

from agglom_mpi.storage.access import DamagedCampaign, report_damage
from agglom_mpi.storage.writer import CampaignWriter


def outside_rows(path):
    """Offsets of all bytes that belong to no dataset."""
    free = np.ones(path.stat().st_size, bool)
    with h5py.File(path, "r") as file:
        for dataset in file.values():
            first = dataset.id.get_offset()
            free[first : first + dataset.id.get_storage_size()] = False
    return np.flatnonzero(free)


@pytest.mark.parametrize("flips", [60, pytest.param(300, marks=pytest.mark.slow)])
def test_a_flipped_bit_in_the_bytes_of_hdf5_is_named_or_harmless(tmp_path, flips):
    path = make(tmp_path / "grains.h5", text="a: 1")
    with CampaignWriter(path) as writer:
        put_strings(writer, 0, 5)
        writer.put_samples(sample_rows(2, 0, 9))
    chance = np.random.default_rng(5)
    places = chance.choice(outside_rows(path), flips).tolist()
    flipped = [[(place, int(chance.integers(8)))] for place in places]
    (tmp_path / "flips.json").write_text(json.dumps(flipped))
    words = [sys.executable, flipped_bits.__file__, path, tmp_path / "flips.json"]
    with program(words) as process:
        said, errors = output_of(process)
    assert process.returncode == 0, errors
    found = json.loads(said)
    assert flips < 30 * found.count(REFUSED) < 20 * flips
    # Some damage makes HDF5 crash by itself, 1.10 more often, and nothing above it can catch that.
    crashes = {-signal.SIGSEGV, -signal.SIGBUS, -signal.SIGABRT}
    assert set(found) <= {SOUND, REFUSED} | crashes
    assert sum(code < 0 for code in found) < 10


def test_a_failed_system_call_is_not_taken_for_damage(tmp_path):
    with pytest.raises(OSError, match="Input/output error"), report_damage(tmp_path):
        raise OSError(errno.EIO, "Input/output error")
    with pytest.raises(DamagedCampaign, match="inflate failed"), report_damage(tmp_path):
        raise OSError("inflate failed")
