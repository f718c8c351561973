"""The section on a certificate: what it takes, what fits, and that it decides no sample."""

import click
import pytest
from campaign_text import campaign

from agglom_mpi.cli.certify import certify
from agglom_mpi.config.plan import CertificatePlan, read_tolerance
from agglom_mpi.config.yaml_source import CampaignError
from agglom_mpi.declaration.components import UnknownComponentError
from agglom_mpi.search.objectives.objective import Objective

GIVEN = "{claim: 80%, strings: 40, robust: {relative_speed: 5%}}"
MOMENTS = {"law": "moments", "targets": {"mean": 2.0, "spread": 0.4}}
NO_SCALE = {"law": "moments", "targets": {"skewness": 0.0, "third": 0.0}}
FUNCTION = {"law": "function", "call": "a:b"}


def test_what_is_not_given_is_as_the_command_has_it():
    assert campaign().plan.certify is None
    assert campaign(("title", "certify: none")).plan.certify is None
    assert campaign(("title", "certify: {}")).plan.certify == CertificatePlan()
    plan = campaign(("title", f"certify: {GIVEN}")).plan.certify
    assert (plan.claim, plan.strings, plan.robust) == (0.8, 40, {"relative_speed": 0.05})
    assert plan.max_samples == CertificatePlan().max_samples == 2560


def test_the_command_has_an_option_for_each_key_with_its_default():
    with click.Context(certify) as context:
        options = {each.name: each.get_help_record(context) for each in certify.params[1:]}
    assert [*options][: len(CertificatePlan.model_fields)] == [*CertificatePlan.model_fields]
    for name, value in CertificatePlan():
        assert name == "robust" or f"[default: {value}]" in options[name][1]


def test_it_decides_no_sample_of_the_search():
    assert campaign(("title", f"certify: {GIVEN}")).identity() == campaign().identity()


def test_a_recorded_plan_is_the_same():
    plan = CertificatePlan(claim="80%", robust={"hardness": "2%", "friction": 0.1})
    assert CertificatePlan.of_identity(plan.recorded_entries()) == plan


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("{claim: 1.2}", "1: certify.claim: is 1.2; must be"),
        ("{claims: 0.9}", "1: certify.claims: unknown key"),
        ("{confidence: much}", "1: certify.confidence: is 'much'"),
        ("{strings: 3}", "1: certify.strings: is 3; must be at least 31"),
        ("{claim: 0.99999999}", "1: certify.claim: is 1; no number"),
        ("{max_samples: 10}", "1: certify.max_samples: is 10; must be at least 40"),
        ("{tolerance: 7}", "1: certify.tolerance: is 7.0; must be"),
        ("{robust: {wind: 5%}}", "1: certify.robust.wind: is no searched variable"),
        ("{robust: {relative_speed: 2}}", "1: certify.robust.relative_speed: is 2; must be"),
        ("{robust: 5%}", "1: certify.robust: is"),
        ("5", "1: certify: is 5; must be a mapping"),
    ],
)
def test_a_mistake_is_told_with_its_line(text, message):
    with pytest.raises(CampaignError) as caught:
        campaign(("title", f"certify: {text}"))
    assert message in str(caught.value)


def test_a_campaign_without_a_set_has_none():
    common = "  rule: successive_difference\n  common_configurations: true"
    with pytest.raises(CampaignError, match="certify: needs ensemble"):
        campaign(("title", "certify: {}"), ("  rule", common))


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
