"""Numbers of strings in larger control volumes."""

import numpy as np
import pytest

from agglom_mpi.scheduling.interface import (
    STRING_STRIDE,
    number_in_volume,
    volume_string,
    volumes_of,
)


@pytest.mark.parametrize(("string", "volume"), [(0, 1), (7, 1), (0, 2), (10**11, 1000)])
def test_volume_and_string_are_found_again(string, volume):
    assert volume_string(number_in_volume(string, volume)) == (volume, string)


def test_strings_of_the_own_volume_keep_their_numbers():
    assert number_in_volume(41, 1) == 41
    assert number_in_volume(41, 2) >= STRING_STRIDE


def test_volumes_of_many_numbers_are_found():
    numbers = np.array([number_in_volume(3, volume) for volume in (1, 2, 4, 1)])
    assert volumes_of(numbers).tolist() == [1, 2, 4, 1]
    assert numbers.max() < np.iinfo(np.int64).max // 2
