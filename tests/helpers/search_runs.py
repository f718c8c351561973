"""Small campaigns of every search, in the scene that other tests of runs have compiled."""

import re

from campaign_runs import SMALL, write_campaign

SEARCHES = {
    "surrogate": "{method: surrogate, initial: 9, batch: 7}",  # batches outgrow the first one
    "cmaes": "{method: cmaes, population: 7}",
    "sobol": "{method: sobol, population: 7}",
    "random": "{method: random, population: 7}",
}


def write_search(path, search, samples=3, **numbers):
    """Write a campaign with a section `search` and so many samples of every string."""
    text = write_campaign(path, **SMALL | {"generations": 5} | numbers).read_text()
    ensemble = f"\nensemble: {{rule: fixed, samples: {samples}}}\n"
    for section, changed in (
        (r"\nsearch: .*\n", f"\nsearch: {search}\n"),
        (r"\nensemble:\n(  .*\n)+", ensemble),
    ):
        text, count = re.subn(section, changed, text)
        assert count == 1
    path.write_text(text)
    return path
