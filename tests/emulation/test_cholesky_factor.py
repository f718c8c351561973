import numpy as np
import pytest

from agglom_mpi.emulation.gaussian_process import extended, factored


def positive(n, seed):
    """Return a symmetric positive definite matrix of condition about 100."""
    rng = np.random.default_rng(seed)
    columns, _ = np.linalg.qr(rng.normal(size=(n, n)))
    return columns @ np.diag(10.0 ** rng.uniform(0.0, 2.0, n)) @ columns.T


@pytest.mark.parametrize("steps", [(1, 1), (1, 7, 3), (40, 1), (3, 40, 1, 20)])
def test_a_factor_that_grew_is_that_of_the_whole(steps):
    matrix = positive(sum(steps), len(steps))
    factor, known = factored(matrix[: steps[0], : steps[0]]), steps[0]
    for step in steps[1:]:
        whole = known + step
        factor = extended(factor, matrix[:known, known:whole], matrix[known:whole, known:whole])
        known = whole
    assert np.allclose(factor.root @ factor.root.T, matrix, rtol=0.0, atol=1e-12)
    assert np.all(np.triu(factor.root, 1) == 0.0)
    assert np.allclose(factor.inverse, np.linalg.inv(matrix).diagonal(), rtol=1e-11)
    assert np.allclose(factor.root, factored(matrix).root, rtol=0.0, atol=1e-12)
