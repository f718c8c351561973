import math

import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from measured_samples import bins, census_of


@given(st.floats(-9.0, 1.0), st.floats(1.0, 1e4))
def test_bins_cover_all_sizes_and_are_narrow(decade, ratio):
    smallest = 10.0**decade
    largest = ratio * smallest
    edges = bins(smallest, largest)
    widths = np.diff(np.log(edges))
    assert edges[0] < smallest
    assert largest < edges[-1]
    assert np.all(widths <= math.log(1.02) * (1.0 + 1e-9))
    assert np.ptp(widths) < 1e-9
    assert edges[1] > smallest
    assert edges[-2] < largest or len(edges) == 2


def test_the_diameter_of_a_bin_is_exact_for_equal_particles():
    sizes = 1e-4 * np.cbrt([1, 1, 1, 2, 2, 7])
    census = census_of([[sizes]], 1, bins(1e-4, 2e-4), grains=14)
    filled = census.diameters[census.counts > 0]
    assert np.allclose(filled, np.unique(sizes), rtol=1e-12)
    assert np.all(census.diameters[census.counts == 0] == 0.0)
