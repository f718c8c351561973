import numpy as np
import pytest

from agglom_mpi.inference.criteria import Band, NearMaximum
from agglom_mpi.inference.objective_criteria import (
    UnknownObjectiveError,
    criterion_of,
    read_tolerance,
)

MOMENTS = {"law": "moments", "targets": {"mean": 2.0, "spread": 0.4}}
NO_SCALE = {"law": "moments", "targets": {"skewness": 0.0, "third": 0.0}}
FUNCTION = {"law": "function", "call": "a:b"}


def test_each_objective_has_its_criterion():
    growth = criterion_of({"law": "growth_target", "ratio": 2.0}, 0.05)
    assert isinstance(growth, Band)
    assert growth.bounds() == pytest.approx((1.9, 2.1))
    most = criterion_of({"law": "maximum_growth"}, 0.02)
    assert isinstance(most, NearMaximum)
    assert most.share == pytest.approx(0.98)
    function = criterion_of(FUNCTION, 0.3)
    assert function.quantities == ("objective",)
    assert function.bounds() == (-np.inf, 0.3)
    moments = criterion_of(MOMENTS, 0.05)
    assert moments.quantities == ("mean", "spread")
    assert moments.scales == pytest.approx([0.1, 0.02])


@pytest.mark.parametrize("law", ["entropy", "Function", ""])
def test_an_unknown_objective_is_no_function(law):
    for call in (criterion_of, read_tolerance):
        with pytest.raises(UnknownObjectiveError, match=repr(law)):
            call({"law": law, "call": "a:b"}, 0.05)


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
    assert read_tolerance(objective, given) == tolerance


@pytest.mark.parametrize(
    ("objective", "given"),
    [({"law": "maximum_growth"}, 1.0), (MOMENTS, 3.0), (NO_SCALE, 0.0), (NO_SCALE, -1.0)],
)
def test_other_tolerances_are_refused(objective, given):
    with pytest.raises(ValueError, match="is "):
        read_tolerance(objective, given)
