"""The section `stopping`: a key for each criterion that ends a campaign."""

from typing import Annotated, ClassVar

import pytest
from campaign_text import campaign

from agglom_mpi.config.plan import Stopping, with_criteria
from agglom_mpi.config.yaml_source import CampaignError
from agglom_mpi.declaration.components import Whole
from agglom_mpi.declaration.declared import Declared
from agglom_mpi.search.ending import (
    EndingCriterion,
    ExpectedError,
    Generations,
    MeanOfBest,
    any_of,
)

LOW = MeanOfBest(top=6, objective=0.5)
KNOWN = ExpectedError(expected_error=0.1)


def test_a_campaign_ends_by_its_criteria_or_its_last_generation():
    stopping = Stopping(generations=4, target=LOW, expected_error=0.1)
    assert stopping.criteria == {"target": LOW, "expected_error": KNOWN}
    assert stopping.ending == any_of(LOW, KNOWN, Generations(generations=4))
    assert stopping.recorded_criteria() == {
        "target": {"top": 6, "objective": 0.5},
        "expected_error": 0.1,
    }
    assert Stopping(generations=4).recorded_criteria() == {"target": None}


def test_a_criterion_is_declared_by_its_class_alone():
    class Stalled(EndingCriterion):
        """No better string was found in so many generations."""

        key: ClassVar[str] = "stalled"
        summary: ClassVar[str] = "no better string for so many generations"
        reached: ClassVar[str] = "no better string was found"
        stalled: Annotated[int, Whole(at_least=1)]

        def holds(self, generations, search):
            return False

    section = with_criteria(Declared)
    Stalled.in_files = False  # for other tests
    assert list(section.model_fields) == ["target", "expected_error", "stalled"]
    assert section.checked({"stalled": 3}).stalled == Stalled(stalled=3)
    assert section.checked({"stalled": 3}).entries() == {"target": None, "stalled": 3}
    assert section.checked({}).entries() == {"target": None}
    with pytest.raises(ValueError, match="stalled"):
        section.checked({"stalled": 0})


@pytest.mark.parametrize(
    ("entry", "field"),
    [
        ("expected_error: 0", "stopping.expected_error"),
        ("expected_error: {error: 0.1}", "stopping.expected_error"),
        ("expected_error: 0.1", "stopping.expected_error"),
        ("target: 5", "stopping.target"),
        ("target: {top: 6}", "stopping.target.objective"),
        ("target: {top: 21, objective: 0.1}", "stopping.target.top"),
        ("target: {top: 6, objective: -0.1}", "stopping.target.objective"),
        ("target: {top: 6, objective: 0.1, key: target}", "stopping.target.key"),
    ],
)
def test_a_criterion_that_is_wrong_is_one_message_with_its_field(entry, field):
    with pytest.raises(CampaignError) as caught:
        campaign(("  target", f"  {entry}"))
    [problem] = caught.value.problems
    assert problem.field == field
    assert problem.line is not None
