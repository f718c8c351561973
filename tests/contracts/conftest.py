import pytest

from agglom_mpi.contracts import tested_laws
from agglom_mpi.contracts.points import draw_points


@pytest.fixture
def few_points(monkeypatch):
    """Test properties of laws at an eighth of the random points, at least 20."""
    monkeypatch.setattr(
        tested_laws,
        "draw_points",
        lambda domain, seed, count: draw_points(domain, seed, min(count, max(20, count // 8))),
    )
