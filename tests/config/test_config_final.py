"""The section on the final answer: on by default, off when asked, and part of no identity."""

import pytest
from campaign_text import campaign

from agglom_mpi.config.plan import FinalAnswer
from agglom_mpi.config.yaml_source import CampaignError


def test_the_best_are_estimated_again_unless_it_is_switched_off():
    assert campaign().final == FinalAnswer(strings=6, samples=100)
    assert campaign(("title", "final: {samples: 300}")).final == FinalAnswer(samples=300)
    assert campaign(("title", "final:")).final == FinalAnswer()
    assert campaign(("title", "final: none")).final is None


@pytest.mark.parametrize("text", ["none", "{strings: 2, samples: 5}"])
def test_it_decides_nothing(text):
    assert campaign(("title", f"final: {text}")).identity() == campaign().identity()


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("{strings: 0}", "1: final.strings: is 0; must be at least 1"),
        ("{samples: 1}", "1: final.samples: is 1; must be at least 2"),
        ("{samples: 2000000}", "1: final.samples: is 2000000; must be at most 1000000"),
        ("{samples: many}", "1: final.samples: is 'many'; must be a whole number"),
        ("{sample: 9}", "1: final.sample: "),
        ("{sample: 9}", "did you mean 'samples'?"),
        ("3", "1: final: "),
        ("some", "1: final: "),
    ],
)
def test_a_mistake_is_told_with_its_line(text, message):
    with pytest.raises(CampaignError) as caught:
        campaign(("title", f"final: {text}"))
    assert message in str(caught.value)


def test_the_description_says_what_is_estimated_again():
    assert "final answer: the best 6 strings estimated again, each on 100" in campaign().describe()
    one = campaign(("title", "final: {strings: 1, samples: 7}")).describe()
    assert "final answer: the best string estimated again, each on 7 fresh samples" in one
    assert "final answer: none; objectives are" in campaign(("title", "final: none")).describe()
