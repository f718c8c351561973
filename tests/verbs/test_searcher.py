"""A search in a loop of one's own proposes what a run does for the same values."""

import re

import numpy as np
import pytest
from campaign_runs import QUICKSTART, SMALL, finish, write_campaign

from agglom_mpi import load_campaign
from agglom_mpi.config.given_strings import read_strings
from agglom_mpi.config.yaml_source import CampaignError
from agglom_mpi.storage.reader import read_campaign
from agglom_mpi.storage.schema import parameters_of

SEARCHES = {
    "genetic": "{population: 8, parents: 4}",
    "resampled": "{population: 8, parents: 4, more_samples: 2}",
    "cmaes": "{method: cmaes, population: 6}",
    "surrogate": "{method: surrogate, initial: 8, batch: 4}",
    "sobol": "{method: sobol, population: 6}",
    "random": "{method: random, population: 6}",
}
STOPPING = "stopping:\n  generations: 4"


def write_search(path, search):
    """Write the quickstart campaign with three samples of each string and another search."""
    text = QUICKSTART.read_text()
    begin, end = text.index("search:"), text.index("stopping:")
    ensemble = "ensemble: {rule: fixed, samples: 3}\n\n"
    text = f"{text[:begin]}search: {search}\n\n{ensemble}final: none\n\n{STOPPING}\n"
    assert end > begin
    path.write_text(text)
    return path


@pytest.mark.parametrize("name", SEARCHES)
def test_the_results_of_a_run_make_it_propose_what_the_run_did(name, tmp_path):
    path = write_search(tmp_path / "run.yaml", SEARCHES[name])
    finish(tmp_path, "run.yaml")
    data = read_campaign(tmp_path / "run.h5")
    campaign, rows, results = load_campaign(path), data.string_rows(), data.result_rows()
    searcher = campaign.searcher()
    objective, told = campaign.objective, 0
    pooled = {}
    while not searcher.is_finished:
        strings = searcher.ask()
        new, found = rows[strings["string"]], results[strings["string"]]
        assert strings.parameters.tobytes() == parameters_of(new).tobytes()
        assert searcher.ask().parameters.tobytes() == strings.parameters.tobytes()
        signed = [
            objective.signed(float(row["objective"]), float(row["mean_radius_ratio"]))
            for row in found
        ]
        samples = []
        for row, parameters, origin in zip(
            found, strings.parameters, strings["origin"], strict=True
        ):
            before = pooled.get(parameters.tobytes(), 0) if origin == "again" else 0
            pooled[parameters.tobytes()] = before + int(row["samples_used"])
            samples.append(pooled[parameters.tobytes()])
        searcher.tell(signed, errors=found["standard_error"], samples=samples)
        told += len(new)
    assert told == len(rows)
    assert searcher.generation == 4
    best = data.generation_rows()[-1]
    assert searcher.best.string == best["best_string"]
    assert searcher.best.value == pytest.approx(best["best_objective"], rel=1e-12)
    assert searcher.best.error == pytest.approx(best["best_standard_error"], rel=1e-12)


@pytest.fixture
def searcher(tmp_path):
    return load_campaign(write_campaign(tmp_path / "small.yaml", **SMALL)).searcher()


def test_the_strings_are_a_table_that_can_be_simulated(searcher, tmp_path):
    pd = pytest.importorskip("pandas")
    campaign = load_campaign(tmp_path / "small.yaml")
    strings = searcher.ask()
    assert pd.DataFrame(strings)["string"].tolist() == list(range(12))
    assert strings.units["relative_speed"] == "m/s"
    by_table, by_array = map(campaign.simulate_many, (strings, strings.parameters))
    assert np.array_equal(by_table.mean_radius_ratio, by_array.mean_radius_ratio)
    frame = campaign.simulate_many(pd.DataFrame(strings))
    assert np.array_equal(frame.mean_radius_ratio, by_array.mean_radius_ratio)
    strings.parameters[:] = 0.0
    assert (searcher.ask().parameters[:, 0] > 0.0).all()


def test_a_string_that_cannot_be_judged_ranks_last(searcher):
    count = len(searcher.ask()["string"])
    values = np.arange(count, dtype=float)
    values[0], values[1] = np.nan, np.inf
    searcher.tell(values, errors=0.5)
    assert searcher.best[:3] == (2, 2.0, 0.5)
    assert [ranked.string for ranked in searcher._search.best(count)[-2:]] == [0, 1]


def test_a_series_is_ordered_by_its_index_and_masked_values_are_not_judged(searcher):
    pd = pytest.importorskip("pandas")
    count = len(searcher.ask()["string"])
    with pytest.raises(CampaignError, match="values: have another index"):
        searcher.tell(pd.Series(np.zeros(count), index=range(1, count + 1)))
    backwards = np.arange(count, dtype=float)[::-1]
    searcher.tell(pd.Series(backwards, index=backwards.astype(int)))
    assert searcher.best[:2] == (0, 0.0)
    values = np.ma.masked_less(np.zeros(len(searcher.ask()["string"])), -1.0)
    values[1:] = np.ma.masked
    searcher.tell(values)
    last = searcher._search.best(2 * count)[-1]
    assert last.string > count
    assert last.objective == np.inf


def test_a_volume_fraction_is_called_what_the_campaign_calls_it(tmp_path):
    text = write_campaign(tmp_path / "c.yaml", **SMALL).read_text()
    text = re.sub(r"(?m)^  size_ratio:.*$", "  volume_fraction: [0.05, 0.2]", text)
    (tmp_path / "c.yaml").write_text(text)
    searcher = load_campaign(tmp_path / "c.yaml").searcher()
    strings = searcher.ask()
    assert "size_ratio" not in strings
    assert strings.units["volume_fraction"] == "1"
    fractions = strings["volume_fraction"]
    assert ((fractions > 0.05 - 1e-12) & (fractions < 0.2 + 1e-12)).all()
    read = read_strings(searcher._campaign, strings)
    assert np.allclose(read, strings.parameters, rtol=1e-12, atol=0.0, equal_nan=True)
    searcher.tell(np.arange(len(fractions), dtype=float))
    assert searcher.best.parameters["volume_fraction"] == pytest.approx(fractions[0])


def test_errors_weigh_values_as_samples_do(tmp_path):
    path = write_search(tmp_path / "run.yaml", SEARCHES["surrogate"])
    by_errors, by_samples = (load_campaign(path).searcher() for _ in range(2))
    random = np.random.default_rng(3)
    for generation in range(3):
        strings = by_errors.ask()
        count = len(strings["string"])
        values, samples = random.normal(size=count), random.integers(1, 9, count)
        samples[0] = 1
        by_errors.tell(values, errors=0.3 / np.sqrt(samples))
        by_samples.tell(values, samples=samples)
        assert generation == strings.generation
    by_errors, by_samples = by_errors.ask().parameters, by_samples.ask().parameters
    assert np.allclose(by_errors, by_samples, rtol=1e-6, equal_nan=True)


def test_criteria_of_the_campaign_end_it(tmp_path):
    path = write_search(tmp_path / "run.yaml", SEARCHES["genetic"])
    path.write_text(f"{path.read_text()}  target: {{top: 2, objective: 0.1}}\n")
    searcher = load_campaign(path).searcher()
    searcher.tell(np.linspace(-0.05, 0.5, 8))
    assert searcher.is_finished
    assert searcher.why_finished
    with pytest.raises(CampaignError, match=r"run\.yaml: stopping: "):
        searcher.ask()
    with pytest.raises(CampaignError, match=r"run\.yaml: stopping: "):
        searcher.tell(np.zeros(4))


@pytest.mark.parametrize(
    ("arguments", "expected"),
    [
        ({"values": [1.0, 2.0]}, r"values: have the shape \(2,\); must be 12 numbers"),
        ({"values": 1.0}, r"values: have the shape \(\); must be 12 numbers"),
        ({"values": ["one"] * 12}, "values: are list; must be numbers"),
        ({"values": np.ones(12), "errors": -0.1}, "errors: is -0.1; must be"),
        ({"values": np.ones(12), "errors": [0.1] * 11 + [np.nan]}, "errors: is nan; must be"),
        ({"values": np.ones(12), "samples": 0}, "samples: is 0; must be"),
        ({"values": [1e300] * 12}, "values: is 1e.300; must be"),
    ],
)
def test_values_that_do_not_fit_are_named_and_change_nothing(searcher, arguments, expected):
    before = searcher.ask().parameters
    with pytest.raises(CampaignError, match=expected):
        searcher.tell(**arguments)
    assert searcher.generation == 0
    assert np.array_equal(searcher.ask().parameters, before, equal_nan=True)


def test_nothing_is_best_before_values_are_told(searcher):
    with pytest.raises(CampaignError, match="best: is unknown"):
        _ = searcher.best


def test_a_searcher_and_its_strings_are_short_in_words(searcher):
    assert "generation 0, 12 strings (0 to 11)" in repr(searcher.ask())
    searcher.tell(np.linspace(0.1, 1.0, 12))
    assert "by genetic: 1 generation judged; best 0.1" in repr(searcher)


def test_a_scene_alone_has_no_search(tmp_path):
    path = tmp_path / "alone.yaml"
    text = QUICKSTART.read_text()
    fixed = text[: text.index("objective:")].replace("[0.1, 30]", "2").replace("[0.4, 0.8]", "0.5")
    path.write_text(fixed.replace("[10 MPa, 200 MPa]", "60 MPa"))
    with pytest.raises(CampaignError, match=r"alone\.yaml"):
        load_campaign(path).searcher()
