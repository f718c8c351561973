"""The section on how strings are proposed, variables by their logarithms, fixed ensembles."""

from pathlib import Path

import numpy as np
import pytest
from campaign_text import campaign

from agglom_mpi.config.loading import load_campaign
from agglom_mpi.config.yaml_source import CampaignError
from agglom_mpi.declaration.given_values import EarlierCampaign

JOBS = Path(__file__).parents[2] / "jobs"

IDENTITIES = {
    "accretion_2003": "498e8c843ea34428",
    "accuracy/accretion_2003_row_1": "d495ff3c390dfefe",
    "accuracy/agglomeration_2004_row_1": "f2637b673cc15786",
    "agglomeration_2004": "f3a5208ca99f8224",
    "extremes/all_merge_at_once": "099a47de5ecd9fca",
    "extremes/always_breaking": "5947036baab0a872",
    "extremes/at_rest": "1a72e78bb6039da9",
    "extremes/cascade": "329d041afeb6cec3",
    "extremes/coarse_steps": "b766e84ea4423cbe",
    "extremes/cold": "8bbcd47062d2359f",
    "extremes/collapse": "bb890e1fdc70144c",
    "extremes/creeping": "dce804d93720038d",
    "extremes/elastic": "3baaea55e9d530e0",
    "extremes/fast_mean_flow": "f4592018d2ea52d7",
    "extremes/fast_radiation": "fb214f45cf00427f",
    "extremes/fold": "868827241bbb82d3",
    "extremes/hard": "87643fa49e37f3a5",
    "extremes/hot": "b95db40123114ff1",
    "extremes/hot_surroundings": "e750433c530bd29c",
    "extremes/hypervelocity": "1a9732de345dc517",
    "extremes/kilometres": "5d3456c37dc05dfe",
    "extremes/marginal_bonding": "09aeec53e9cc3b88",
    "extremes/mass_ratio": "7b2da5c32dd4691a",
    "extremes/nanometres": "bdb78b5a5652f72c",
    "extremes/nearly_jammed": "0bd0f44d0bb713af",
    "extremes/no_time": "2005a38e2b68136b",
    "extremes/perfectly_plastic": "f4e42567c242b0e4",
    "extremes/slow_radiation": "04d371724d339a47",
    "extremes/soft": "dbb7bf864986563a",
    "extremes/strong_softening": "16a23733a07160d0",
    "extremes/thermal_runaway": "f6603938f1a3c762",
    "extremes/thousand_pieces": "bfb87c7ea0407eb1",
    "extremes/two_particles": "c3d359b759e55c7c",
    "extremes/very_dilute": "9e476e0ee5b81ec2",
    "extremes/zero_initial_contact_area": "981141bd2aae43f6",
    "quickstart": "25892dbbdc02ccc5",
}
"""First digits of the identities that these campaigns had before there was any other search."""


@pytest.mark.parametrize("job", IDENTITIES)
def test_campaigns_from_before_other_searches_keep_their_identity(job: str) -> None:
    assert load_campaign(JOBS / f"{job}.yaml").sha256()[:16] == IDENTITIES[job]


def message(*edits: tuple[str, str]) -> str:
    with pytest.raises(CampaignError) as caught:
        campaign(*edits)
    return str(caught.value)


@pytest.mark.parametrize(
    ("section", "expected"),
    [
        (
            "{method: annealing}",
            ("search.method:", "is 'annealing'", "genetic", "surrogate", "cmaes", "random"),
        ),
        (
            "{method: }",
            ("search.method:", "is empty", "genetic", "surrogate", "cmaes", "random", "sobol"),
        ),
        ("surrogate", ("search:", "is 'surrogate'", "a mapping")),
        (
            "{method: surrogate, population: 20}",
            ("search.population:", "unknown key 'population'", "allowed: start, method, initial"),
        ),
        (
            "{method: cmaes, parents: 4}",
            ("search.parents:", "unknown key 'parents'", "allowed: start, popul"),
        ),
        (
            "{method: cmaes, rescale: none}",
            ("search.rescale:", "unknown key 'rescale'", "allowed: start, popu"),
        ),
        (
            "{method: random, sigma: 0.1}",
            ("search.sigma:", "unknown key 'sigma'", "allowed: start, population"),
        ),
        (
            "{method: sobol, batch: 4}",
            ("search.batch:", "unknown key 'batch'", "allowed: start, population, m"),
        ),
        (
            "{population: 12, parents: 6, batch: 8}",
            ("search.batch:", "unknown key 'batch'", "allowed: start, population, method, p"),
        ),
        (
            "{batch: 8, intial: 16}",
            ("search.intial:", "unknown key 'intial'", "did you mean 'initial'"),
        ),
        ("{method: surrogate, batch: 1}", ("search.batch:", "is 1", "at least 2")),
        ("{method: surrogate, batch: 10001}", ("search.batch:", "is 10001", "at most 10000")),
        ("{method: surrogate, batch: 24.5}", ("search.batch:", "is 24.5", "whole number")),
        ("{method: surrogate, initial: 7}", ("search.initial:", "is 7", "at least 8")),
        ("{method: surrogate, initial: 10001}", ("search.initial:", "is 10001", "at most 10000")),
        ("{method: cmaes, population: 3}", ("search.population:", "is 3", "at least 4")),
        ("{method: cmaes, sigma: 0}", ("search.sigma:", "is 0", "greater than 0")),
        ("{method: cmaes, sigma: 1.1}", ("search.sigma:", "is 1.1", "at most 1")),
        ("{method: cmaes, sigma: wide}", ("search.sigma:", "is the text 'wide'")),
        ("{method: sobol, population: 0}", ("search.population:", "is 0", "at least 1")),
        (
            "{method: random, population: 100001}",
            ("search.population:", "is 100001", "at most 100000"),
        ),
    ],
)
def test_a_search_that_is_none_is_one_message(section: str, expected: tuple[str, ...]) -> None:
    said = message(("search", f"search: {section}"))
    assert said.startswith(f"campaign.yaml:27: {expected[0]}")
    assert all(part in said for part in expected)
    assert "\n" not in said


@pytest.mark.parametrize(
    ("start", "expected"),
    [
        ("5", ("search.start:", "is 5", "a list")),
        ("[]", ("search.start:", "is []", "a list")),
        ("[5]", ("search.start.0:", "is 5", "6000", "a mapping")),
        ("[{density: 6000}]", ("search.start.0.density:", "is not searched")),
        ("[{surface_energy: 1}]", ("search.start.0.surface_energy:", "is not searched")),
        ("[{}, {hardness: 5}]", ("search.start.1.hardness:", "is 5", "1e+07", "2e+08")),
        (
            "[{hardness: 1 m}]",
            ("search.start.0.hardness:", "wrong unit", "'m'", "'Pa'"),
        ),
        ("[{hardness: -1}]", ("search.start.0.hardness:", "is -1", "greater than 0")),
        ("[{hardnes: 1e8}]", ("search.start.0.hardnes:", "'hardness'")),
        ("[{size_ratio: 0.5}, {}, {size_ratio: 0.5}]", ("search.start.2:",)),
        (
            "[{}, {size_ratio: 0.5}, {hardness: 1e8}, {hardness: 1.5e8}, {hardness: 1.6e8}]",
            ("search.start:", "5", "at most 4"),
        ),
        ("{strings: 2}", ("search.start.file:", "is missing")),
        ("{file: 5}", ("search.start.file:", "is 5")),
        ("{file: ''}", ("search.start.file:", "is ''")),
        ("{file: a.h5, strings: 0}", ("search.start.strings:", "is 0", "at least 1")),
        ("{file: a.h5, strings: 5}", ("search.start.strings:", "5", "at most 4")),
        ("{file: a.h5, string: 3}", ("search.start.string:", "unknown key 'string'", "'strings'")),
    ],
)
@pytest.mark.parametrize("method", ["population: 4, parents: 2", "method: surrogate, initial: 8"])
def test_strings_that_cannot_be_begun_with_are_one_message(
    method: str, start: str, expected: tuple[str, ...]
) -> None:
    said = message(("search", f"search: {{{method}, start: {start}}}"))
    assert said.startswith(f"campaign.yaml:27: {expected[0]}")
    assert all(part in said for part in expected)
    assert "\n" not in said


def test_a_given_string_is_located_by_its_own_line() -> None:
    begin = "search:\n  population: 12\n  parents: 4\n  start:\n    - {hardness: 1e8}\n"
    said = message(("search", begin + "    - {hardness: 5, size_ratio: 0.3}"))
    lines = [
        "campaign.yaml:32: search.start.1.hardness: is 5; must be within its range, 1e+07 to 2e+08",
        "campaign.yaml:32: search.start.1.size_ratio: is 0.3; must be within its range, 0.4 to 0.8",
    ]
    assert said.splitlines() == lines


WRITTEN = "must be one value, or a range [lower, upper] or [lower, upper, log]"


@pytest.mark.parametrize(
    ("entry", "expected"),
    [
        ("[0, 30, log]", "is [0, 30, 'log']; without 0, to be searched by its logarithm"),
        ("[1, 2, lin]", f"is [1, 2, 'lin']; {WRITTEN}"),
        ("[1, 2, 3]", f"is [1, 2, 3]; {WRITTEN}"),
        ("[1, 2, log, log]", f"is [1, 2, 'log', 'log']; {WRITTEN}"),
        ("[1, 2, [log]]", f"is [1, 2, ['log']]; {WRITTEN}"),
        ("[1, log]", "is the text 'log'; must be a number in m/s, or a text with a unit"),
        ("[2, 1, log]", "is [2, 1, 'log']; the lower end must be less than the upper"),
    ],
)
def test_a_range_that_is_none_is_one_message(entry: str, expected: str) -> None:
    said = message(("  relative_speed", f"  relative_speed: {entry}"))
    assert said.startswith(f"campaign.yaml:17: variables.relative_speed: {expected}")
    assert "\n" not in said


def fixed(samples: str) -> tuple[tuple[str, str], ...]:
    """Edits that make the ensemble one of a fixed number of samples."""
    return ("  rule", "  rule: fixed"), ("  tolerance", samples), ("  max_samples", "")


@pytest.mark.parametrize(
    ("samples", "expected"),
    [
        ("", "28: ensemble.samples: is missing; a number of samples"),
        ("  samples: 0", "30: ensemble.samples: is 0; must be at least 1"),
        ("  samples: 1000001", "30: ensemble.samples: is 1000001; must be at most 1000000"),
        ("  samples: 1.5", "30: ensemble.samples: is 1.5; must be a whole number"),
        (
            "  samples: 3\n  tolerance: 1e-3",
            "31: ensemble.tolerance: unknown key 'tolerance'; "
            "allowed: common_configurations, rule, samples",
        ),
        (
            "  samples: 3\n  min_samples: 2",
            "31: ensemble.min_samples: unknown key 'min_samples'; did you mean 'samples'?",
        ),
    ],
)
def test_a_fixed_ensemble_that_is_none_is_one_message(samples: str, expected: str) -> None:
    assert message(*fixed(samples)) == f"campaign.yaml:{expected}"


def test_a_fixed_ensemble_has_as_many_samples_at_least_and_at_most() -> None:
    ensemble = campaign(*fixed("  samples: 3")).ensemble
    assert (ensemble.min_samples, ensemble.max_samples) == (1, 3)


def test_what_is_not_said_has_a_default() -> None:
    searches = {
        method: campaign(("search", f"search: {{method: {method}}}")).search.model_dump()
        for method in ("genetic", "surrogate", "cmaes", "random", "sobol")
    }
    assert all(search.pop("start") is None for search in searches.values())
    assert all(search.pop("method") == method for method, search in searches.items())
    assert searches["genetic"].pop("more_samples") is None
    assert searches == {
        "genetic": {"population": 20, "parents": 6, "blend": (0.0, 1.0), "rescale": None},
        "surrogate": {
            "initial": 48,
            "batch": 24,
            "aim": "best",
            "tolerance": None,
            "learn_from": None,
        },
        "cmaes": {"population": 20, "sigma": 0.3},
        "random": {"population": 20},
        "sobol": {"population": 20},
    }


@pytest.mark.parametrize(
    ("section", "method"),
    [
        ("", "surrogate"),
        ("search: {}", "surrogate"),
        ("search: {batch: 12, aim: set}", "surrogate"),
        ("search: {start: [{hardness: 50 MPa}]}", "surrogate"),
        ("search: {population: 12}", "genetic"),
        ("search: {parents: 2}", "genetic"),
        ("search: {rescale: none}", "genetic"),
    ],
)
def test_a_search_without_a_method_is_a_surrogate_unless_it_has_keys_of_the_genetic_one(
    section, method
) -> None:
    assert campaign(("search", section)).search.method == method


@pytest.mark.parametrize(
    ("section", "generations", "strings", "population"),
    [
        ("{method: surrogate, initial: 9, batch: 4}", 1, 5, 4),
        ("{method: surrogate, initial: 9, batch: 4}", 2, 9, 4),
        ("{method: surrogate, initial: 9, batch: 7}", 5, 30, 5),
        ("{method: cmaes, population: 6}", 5, 30, 6),
        ("{method: random, population: 1}", 5, 5, 1),
    ],
)
def test_strings_are_counted(section: str, generations: int, strings: int, population: int) -> None:
    edits = ("search", f"search: {section}"), ("  generations", f"  generations: {generations}")
    loaded = campaign(*edits)
    assert (loaded.max_strings, loaded.search.population) == (strings, population)


def test_given_strings_are_in_si_units_and_filled_with_the_middle() -> None:
    start = "[{hardness: 100 MPa}, {relative_speed: 30, size_ratio: 0.4}]"
    strings = campaign(("search", f"search: {{start: {start}}}")).given_strings()
    assert strings[:, :4].tolist() == [
        [15.05, pytest.approx(0.6), 6000.0, 1e8],
        [30.0, 0.4, 6000.0, 1.05e8],
    ]
    assert np.isnan(strings[:, 9]).all()
    assert campaign().given_strings().shape == (0, 10)


def test_an_earlier_campaign_gives_its_best_string_unless_more_are_asked_for() -> None:
    start = campaign(("search", "search: {start: {file: a.h5}}")).search.start
    assert start == EarlierCampaign(file="a.h5", strings=1)


@pytest.mark.parametrize(
    ("edit", "key"),
    [
        (("search", "search: {method: surrogate}"), "search.method"),
        (("search", "search: {method: cmaes, population: 12}"), "search.sigma"),
        (("search", "search: {population: 12, parents: 4, start: [{}]}"), "search.start.0"),
        (
            ("search", "search: {population: 12, parents: 4, start: [{hardness: 1e8}]}"),
            "search.start.0.hardness",
        ),
        (
            ("search", "search: {population: 12, parents: 4, start: {file: a.h5}}"),
            "search.start.file",
        ),
        (("  hardness: [", "  hardness: [1e7, 2e8, log]"), "variables.hardness.2"),
    ],
)
def test_start_logarithms_and_method_are_in_the_identity(edit: tuple[str, str], key: str) -> None:
    ours, theirs = campaign().identity(), campaign(edit).identity()
    assert ours.get(key) != theirs.get(key)
    assert campaign(edit).sha256() != campaign().sha256()


@pytest.mark.parametrize(
    ("section", "lines"),
    [
        (
            "{population: 12, parents: 4}",
            ["genetic, population 12, parents 4, blend 0 to 1 [A 22]"],
        ),
        (
            "{method: surrogate, initial: 20, batch: 5}",
            [
                "Gaussian process through all samples, 20 Sobol points first, then batches of 5 by "
                "Thompson sampling"
            ],
        ),
        ("{method: cmaes}", ["CMA-ES, population 20, first standard deviation 0.3 of the box"]),
        ("{method: random}", ["independent random points, 20 in a generation; nothing is learnt"]),
        ("{method: sobol}", ["a Sobol sequence, 20 in a generation; nothing is learnt"]),
    ],
)
@pytest.mark.parametrize(
    ("start", "begins"),
    [
        ("", []),
        (", start: [{}]", ["1 given string"]),
        (", start: [{}, {hardness: 1e8}]", ["2 given strings"]),
        (", start: {file: a.h5, strings: 3}", ["the best 3 of a.h5"]),
    ],
)
def test_the_description_says_how_it_searches_and_what_it_begins_with(
    section: str, lines: list[str], start: str, begins: list[str]
) -> None:
    text = campaign(("search", f"search: {section[:-1]}{start}}}")).describe().splitlines()
    found = [line.removeprefix("  search: ") for line in text if line.startswith("  search: ")]
    assert found == lines
    given = [line.removeprefix("  begins with: ") for line in text if "begins with" in line]
    assert given == begins


def test_the_description_says_what_is_searched_by_its_logarithm_and_how_often() -> None:
    text = campaign(("  hardness: [", "  hardness: [1e7, 2e8, log]"), *fixed("  samples: 1"))
    lines = text.describe().splitlines()
    assert "  hardness          Pa      1e+07 .. 2e+08, logarithmic" in lines
    assert "  relative_speed    m/s     0.1 .. 30" in lines
    assert "  ensemble: 1 sample of every string" in lines
    assert "  samples: 44, 1 per string" in lines
