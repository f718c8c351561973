"""Another seed changes a campaign's text in its seed alone."""

import pytest
from campaign_text import TEXT

from agglom_mpi.config.campaign import Campaign
from agglom_mpi.config.yaml_source import CampaignError, parse, with_seed


@pytest.mark.parametrize(
    ("text", "wanted"),
    [
        ("a: 1\n", "a: 1\nseed: 7\n"),
        ("a: 1", "a: 1\nseed: 7\n"),
        ("seed: 1\na: 2", "seed: 7\na: 2"),
        ("a: 2\nseed : 1  # mine\n", "a: 2\nseed : 7  # mine\n"),
        ('"seed": 1\n', '"seed": 7\n'),
        ("seed:\na: 1\n", "seed: 7\na: 1\n"),
        ("seed: !!int '5'\na: 1\n", "seed: 7\na: 1\n"),
        ("{a: 1, seed: 0x1F}", "{a: 1, seed: 7}"),
        ("{a: 1,\n b: 2}\n", "{seed: 7, a: 1,\n b: 2}\n"),
        ("---\n  a: 1\n  b: 2\n", "---\n  a: 1\n  b: 2\n  seed: 7\n"),
        ("a: 1\n...\n", "seed: 7\na: 1\n...\n"),
        ("a: {seed: 1}\n# seed: 5\n", "a: {seed: 1}\n# seed: 5\nseed: 7\n"),
        ("a: |\n  seed: 3\n", "a: |\n  seed: 3\nseed: 7\n"),
        ("a: .nan\r\nseed: 1\r\n", "a: .nan\r\nseed: 7\r\n"),
    ],
)
def test_a_seed_is_replaced_or_added(text, wanted):
    assert with_seed(text, "c.yaml", 7) == wanted
    assert parse(wanted, "c.yaml").data["seed"] == 7


@pytest.mark.parametrize("text", ["a: &x 3\nseed: *x\n", "seed: &x 3\na: *x\n"])
def test_a_seed_that_is_not_alone_is_refused_with_its_line(text):
    line = text.splitlines().index(next(row for row in text.splitlines() if "seed" in row)) + 1
    with pytest.raises(CampaignError, match=rf"c\.yaml:{line}: seed: cannot be replaced by 7"):
        with_seed(text, "c.yaml", 7)


@pytest.mark.parametrize("text", [TEXT, TEXT.replace("seed: 7\n", "")])
def test_a_campaign_with_another_seed_is_the_one_whose_text_has_it(text):
    changed = Campaign.from_text(text).with_seed(11)
    assert changed.seed == 11
    assert Campaign.from_text(changed.text).identity() == changed.identity()
    assert changed.identity() == Campaign.from_text(text).identity() | {"seed": 11}


@pytest.mark.parametrize("seed", [-1, 2**63, 1.5, "7"])
def test_a_seed_that_no_file_has_room_for_is_refused(seed):
    with pytest.raises(CampaignError, match=r"seed: is .*must be a whole number of at least 0"):
        Campaign.from_text(TEXT).with_seed(seed)
