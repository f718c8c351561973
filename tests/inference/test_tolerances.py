import pytest

from agglom_mpi.declaration.components import UnknownComponentError
from agglom_mpi.inference.tolerances import read_tolerance
from agglom_mpi.search.objectives.objective import Objective

MOMENTS = {"law": "moments", "targets": {"mean": 2.0, "spread": 0.4}}
NO_SCALE = {"law": "moments", "targets": {"skewness": 0.0, "third": 0.0}}
FUNCTION = {"law": "function", "call": "a:b"}


@pytest.mark.parametrize("law", ["entropy", "Function", ""])
def test_an_unknown_objective_is_no_function(law):
    with pytest.raises(UnknownComponentError, match=repr(law)):
        Objective.of_entries({"law": law, "call": "a:b"})


@pytest.mark.parametrize(
    ("objective", "given", "tolerance"),
    [
        ({"law": "maximum_growth"}, "5%", 0.05),
        (MOMENTS, 0.2, 0.2),
        (NO_SCALE, 3.0, 3.0),
        (FUNCTION, -2.5, -2.5),
    ],
)
def test_a_tolerance_is_relative_where_there_is_a_scale(objective, given, tolerance):
    assert read_tolerance(Objective.of_entries(objective), given) == tolerance


@pytest.mark.parametrize(
    ("objective", "given"),
    [({"law": "maximum_growth"}, 1.0), (MOMENTS, 3.0), (NO_SCALE, 0.0), (NO_SCALE, -1.0)],
)
def test_other_tolerances_are_refused(objective, given):
    with pytest.raises(ValueError, match="is "):
        read_tolerance(Objective.of_entries(objective), given)
