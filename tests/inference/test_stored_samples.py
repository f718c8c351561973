import pytest
from set_runs import three_variable_file

from agglom_mpi.inference.stored_samples import favours_low_objectives
from agglom_mpi.storage.reader import read_campaign

SURROGATE = "method: surrogate, initial: 32, batch: 16"


@pytest.mark.parametrize(
    ("search", "generations", "favoured"),
    [
        ("{method: genetic, population: 12, parents: 4}", 2, True),
        ("{method: genetic, population: 12, parents: 4}", 1, False),
        ("{method: cmaes, population: 12}", 2, True),
        (f"{{{SURROGATE}}}", 3, True),
        (f"{{{SURROGATE}}}", 2, False),
        (f"{{{SURROGATE}, aim: set}}", 3, False),
        ("{method: sobol, population: 12}", 2, False),
    ],
)
def test_samples_favours_low_objectives_once_a_search_for_the_best_has_results(
    tmp_path, search, generations, favoured
):
    path = three_variable_file(tmp_path, search=search, generations=generations)
    assert favours_low_objectives(read_campaign(path)) is favoured
