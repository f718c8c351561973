"""Damage to what HDF5 keeps for itself, which no checksum covers."""

import errno

import h5py
import numpy as np
import pytest
from database_helpers import make, put_strings, sample_rows

from agglom_mpi.database.access import DamagedCampaign, NotACampaign, damage_named
from agglom_mpi.database.integrity import read_contents
from agglom_mpi.database.writer import CampaignWriter


def outside_rows(path):
    """Offsets of all bytes that belong to no dataset."""
    free = np.ones(path.stat().st_size, bool)
    with h5py.File(path, "r") as file:
        for dataset in file.values():
            first = dataset.id.get_offset()
            free[first : first + dataset.id.get_storage_size()] = False
    return np.flatnonzero(free)


def test_a_flipped_bit_in_the_bytes_of_hdf5_is_named_or_harmless(tmp_path):
    path = make(tmp_path / "grains.h5", campaign_text="a: 1")
    with CampaignWriter(path) as writer:
        put_strings(writer, 0, 5)
        writer.put_samples(sample_rows(2, 0, 9))
    content = bytearray(path.read_bytes())
    chance = np.random.default_rng(5)
    refusals = []
    for at in chance.choice(outside_rows(path), 300):
        bit = 1 << int(chance.integers(8))
        content[at] ^= bit
        path.write_bytes(content)
        content[at] ^= bit
        try:
            read_contents(path)
        except NotACampaign as error:
            refusals.append(str(error))
    assert 10 < len(refusals) < 100
    assert all(text.startswith(f"{path}: ") and "\n" not in text for text in refusals)
    assert all(text.count(path.name) == 1 for text in refusals)


def test_a_failed_system_call_is_not_taken_for_damage(tmp_path):
    with pytest.raises(OSError, match="Input/output error"), damage_named(tmp_path):
        raise OSError(errno.EIO, "Input/output error")
    with pytest.raises(DamagedCampaign, match="inflate failed"), damage_named(tmp_path):
        raise OSError("inflate failed")
