import pytest

from agglom_mpi.contracts import tested_laws
from agglom_mpi.contracts.subject import RANDOM_CASES


@pytest.fixture
def few_cases(monkeypatch):
    """Test properties of laws in an eighth of the random cases."""
    monkeypatch.setattr(tested_laws, "RANDOM_CASES", RANDOM_CASES // 8)
