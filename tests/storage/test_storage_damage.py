"""Damage to what HDF5 keeps for itself, which no checksum covers."""

import errno
import faulthandler
import os
import signal

import h5py
import numpy as np
import pytest
from storage_rows import make, put_strings, sample_rows

from agglom_mpi.storage.access import DamagedCampaign, NotACampaign, report_damage
from agglom_mpi.storage.verify import verify_rows
from agglom_mpi.storage.writer import CampaignWriter


def outside_rows(path):
    """Offsets of all bytes that belong to no dataset."""
    free = np.ones(path.stat().st_size, bool)
    with h5py.File(path, "r") as file:
        for dataset in file.values():
            first = dataset.id.get_offset()
            free[first : first + dataset.id.get_storage_size()] = False
    return np.flatnonzero(free)


SOUND, REFUSED, WRONG = range(3)
OLD = h5py.version.hdf5_version_tuple < (1, 12)


def read_in_a_child(path):
    """Exit code of a process that reads a file: sound, refused in words, or less than 0, a crash.

    What is raised but a refusal in one line is wrong.
    """
    child = os.fork()
    if child == 0:
        faulthandler.disable()
        code = WRONG
        try:
            verify_rows(path)
            code = SOUND
        except NotACampaign as error:
            text = str(error)
            named = text.startswith(f"{path}: ") and text.count(path.name) == 1
            code = REFUSED if named and "\n" not in text else WRONG
        finally:
            os._exit(code)
    return os.waitstatus_to_exitcode(os.waitpid(child, 0)[1])


@pytest.mark.parametrize("flips", [60, pytest.param(300, marks=pytest.mark.slow)])
def test_a_flipped_bit_in_the_bytes_of_hdf5_is_named_or_harmless(tmp_path, flips):
    path = make(tmp_path / "grains.h5", campaign_text="a: 1")
    with CampaignWriter(path) as writer:
        put_strings(writer, 0, 5)
        writer.put_samples(sample_rows(2, 0, 9))
    content = bytearray(path.read_bytes())
    chance = np.random.default_rng(5)
    found = []
    for at in chance.choice(outside_rows(path), flips):
        bit = 1 << int(chance.integers(8))
        content[at] ^= bit
        path.write_bytes(content)
        content[at] ^= bit
        found.append(read_in_a_child(path))
    assert flips < 30 * found.count(REFUSED) < 10 * flips
    # Some damage makes HDF5 1.10 crash by itself, and nothing above it can catch that.
    crashes = {-signal.SIGSEGV, -signal.SIGBUS, -signal.SIGABRT} if OLD else set()
    assert set(found) <= {SOUND, REFUSED} | crashes
    assert sum(code < 0 for code in found) < 10


def test_a_failed_system_call_is_not_taken_for_damage(tmp_path):
    with pytest.raises(OSError, match="Input/output error"), report_damage(tmp_path):
        raise OSError(errno.EIO, "Input/output error")
    with pytest.raises(DamagedCampaign, match="inflate failed"), report_damage(tmp_path):
        raise OSError("inflate failed")
