"""How many strings tables list, and which columns are derived, by the campaign in the file."""

import json
from pathlib import Path

import pytest
from campaign_runs import QUICKSTART

from agglom_mpi.analysis.derived import DERIVING_KEYS, may_have_key
from agglom_mpi.analysis.ranking import LISTED, listed_strings
from agglom_mpi.config.campaign import Campaign
from agglom_mpi.config.identity import digest
from agglom_mpi.storage.reader import CampaignData
from agglom_mpi.storage.schema import STUDY

CAMPAIGN = QUICKSTART.read_text()
SECTIONS = CAMPAIGN.split("\n\n", 1)[1]
FINAL = "final: {strings: 3, samples: 5}"


def recorded(text, **more):
    """Return the data of a file of a campaign without any rows."""
    campaign = Campaign.from_text(text, "one.yaml")
    identity = campaign.identity()
    attributes = {
        "campaign": text,
        "identity": json.dumps(identity, sort_keys=True),
        "campaign_sha256": digest(identity),
    }
    return CampaignData(Path("one.h5"), attributes | more)


def test_as_many_strings_as_are_estimated_again_are_listed():
    assert listed_strings(recorded(CAMPAIGN)) == LISTED
    assert listed_strings(recorded(f"{CAMPAIGN}\n{FINAL}\n")) == 3
    assert listed_strings(recorded(f"{CAMPAIGN}\n{FINAL}\n", purpose=STUDY)) == LISTED


@pytest.mark.parametrize(
    "text",
    [
        f'{CAMPAIGN}\n"final": {{"strings": 3, samples: 5}}\n',
        f"{CAMPAIGN}\n'final' : {{samples: 5, strings: 3}}\n",
        f'{CAMPAIGN}\n"fi\\x6eal": {{"str\\u0069ngs": 3, samples: 5}}\n',
        f"{CAMPAIGN}\n? final\n: strings: 3\n  samples: 5\n",
        f"# final: strings: 9\n{CAMPAIGN}\nfinal:\n  samples: 5\n  # strings: 7\n  strings: 3\n",
    ],
    ids=["quoted", "spaced", "escaped", "explicit", "comments"],
)
def test_the_key_is_found_however_it_is_written(text):
    assert listed_strings(recorded(text)) == 3


@pytest.mark.parametrize(
    "text",
    [
        f"{CAMPAIGN}\n# final: {{strings: 3, samples: 5}}\n",
        f"title: 'final: strings: 3'\nseed: 1\n{SECTIONS}",
        f"title: >-\n  one\n  final: strings: 3\nseed: 1\n{SECTIONS}",
    ],
    ids=["comment", "text", "block"],
)
def test_words_that_are_no_keys_do_not_count(text):
    assert listed_strings(recorded(text)) == LISTED


def test_a_damaged_text_lists_the_usual_number():
    data = recorded(f"{CAMPAIGN}\n{FINAL}\n")
    data.attributes["campaign"] += "scene: [\n"
    assert listed_strings(data) == LISTED


def test_a_key_may_be_spelt_by_escapes():
    assert not any(may_have_key(recorded(CAMPAIGN), key) for key in DERIVING_KEYS)
    escaped = recorded(CAMPAIGN.replace("hardness:", '"hardn\\x65ss":', 1))
    assert all(may_have_key(escaped, key) for key in DERIVING_KEYS)
