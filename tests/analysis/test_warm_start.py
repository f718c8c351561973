"""A search begins with strings of an earlier campaign that are in its box, by its own rules."""

import numpy as np
import pytest
from campaign_runs import finish
from click.testing import CliRunner
from search_runs import write_search

from agglom_mpi.analysis.ranking import rank_strings
from agglom_mpi.analysis.warm_start import warm_start
from agglom_mpi.cli import main
from agglom_mpi.config.campaign import Campaign
from agglom_mpi.config.loading import load_campaign
from agglom_mpi.config.yaml_source import CampaignError
from agglom_mpi.runtime.invert import InvertOptions, read_request
from agglom_mpi.storage.reader import read_campaign


@pytest.fixture(scope="module")
def earlier(tmp_path_factory):
    """Return the file of a campaign of 14 strings."""
    folder = tmp_path_factory.mktemp("earlier")
    write_search(folder / "one.yaml", "{method: sobol, population: 7}", samples=1, generations=2)
    finish(folder, "one.yaml")
    return folder / "one.h5"


@pytest.fixture(scope="module")
def ranked(earlier):
    """Return numbers and rows of its strings, the best first."""
    data = read_campaign(earlier)
    order = rank_strings(data).order
    return np.array(order), data.string_rows()[order]


def text_of(folder, file, strings, **variables):
    """Return the text of a campaign that begins with strings of a file, in another box."""
    start = f"{{method: random, population: 14, start: {{file: {file}, strings: {strings}}}}}"
    text = write_search(folder / "next.yaml", start).read_text()
    for name, value in variables.items():
        lines = [line for line in text.splitlines() if line.startswith(f"  {name}: ")]
        text = text.replace(lines[-1], f"  {name}: {value}")
    return text


def without_best(ranked):
    """Return a range of size ratios in which the best string is not, but many others are."""
    ratios = ranked[1]["size_ratio"]
    best = float(ratios[0])
    if np.count_nonzero(ratios > best) > 6:
        return best * (1.0 + 1e-6), 0.8
    return 0.4, best * (1.0 - 1e-6)


def test_strings_out_of_the_box_are_named_and_the_next_ones_take_their_places(
    earlier, ranked, tmp_path
):
    numbers, rows = ranked
    lower, upper = without_best(ranked)
    inside = (rows["size_ratio"] >= lower) & (rows["size_ratio"] <= upper)
    assert not inside[0]
    taken = np.flatnonzero(inside)[:4]
    text = text_of(tmp_path, earlier, 4, size_ratio=f"[{lower}, {upper}]")
    found = warm_start(Campaign.from_text(text))
    assert found.strings[:, 1].tolist() == rows["size_ratio"][taken].tolist()
    assert found.strings[:, 3].tolist() == rows["hardness"][taken].tolist()
    [warning] = found.warnings
    left_out = sorted(numbers[: taken[-1]][~inside[: taken[-1]]].tolist())
    wanted = f"one.h5: {', '.join(map(str, left_out))} (size_ratio out of range)"
    assert wanted in str(warning)


def test_what_is_fixed_or_not_searched_before_is_as_the_campaign_says(earlier, ranked, tmp_path):
    text = text_of(tmp_path, earlier, 6, relative_speed=3, density="[5000, 7000]")
    found = warm_start(Campaign.from_text(text))
    assert found.warnings == ()
    assert np.all(found.strings[:, 0] == 3.0)
    assert np.all(found.strings[:, 2] == 6142.0)
    assert found.strings[:, 3].tolist() == ranked[1]["hardness"][:6].tolist()
    assert np.isnan(found.strings[:, 9]).all()


def test_an_end_that_differs_by_rounding_is_that_end(earlier, ranked, tmp_path):
    end = float(ranked[1]["hardness"].max())
    text = text_of(tmp_path, earlier, 14, hardness=f"[1e7, {end * (1.0 - 1e-14)!r}]")
    found = warm_start(Campaign.from_text(text))
    assert found.warnings == ()
    assert found.strings[:, 3].max() == end * (1.0 - 1e-14) < end


@pytest.mark.parametrize(
    ("box", "said"),
    [
        ({"size_ratio": "[0.1, 0.2]"}, "has 14 judged strings, of which 0 can be used (left out: "),
        ({"size_ratio": "[0.1, 0.2]"}, "(size_ratio out of range)); 2 are asked for"),
        # All strings become the same one where nothing is searched that was before.
        (
            {"size_ratio": 0.5, "relative_speed": 3, "hardness": "7e7", "density": "[5e3, 7e3]"},
            "of which 1 can be used",
        ),
    ],
)
def test_too_few_strings_in_the_box_are_refused(earlier, tmp_path, box, said):
    with pytest.raises(CampaignError) as caught:
        warm_start(Campaign.from_text(text_of(tmp_path, earlier, 2, **box)))
    assert said in str(caught.value)
    assert "search.start: " in str(caught.value)


def test_strings_that_break_a_constraint_are_named(earlier, ranked, tmp_path):
    numbers, rows = ranked
    limit = float(np.sort(rows["hardness"])[7])
    allowed = rows["hardness"] < limit
    text = f"constraints: ['hardness < {limit!r} Pa']\n{text_of(tmp_path, earlier, 3)}"
    found = warm_start(Campaign.from_text(text))
    taken = np.flatnonzero(allowed)[:3]
    assert found.strings[:, 3].tolist() == rows["hardness"][taken].tolist()
    left_out = sorted(numbers[: taken[-1]][~allowed[: taken[-1]]].tolist())
    said = [f"{', '.join(map(str, left_out))} (against the constraints)"] if left_out else []
    assert [str(each).partition("one.h5: ")[2] for each in found.warnings] == said


def test_the_earlier_file_is_beside_the_campaign_not_in_the_working_directory(
    earlier, tmp_path, monkeypatch
):
    folder = tmp_path / "campaigns"
    folder.mkdir()
    (folder / "near.h5").write_bytes(earlier.read_bytes())
    (tmp_path / "far.h5").write_bytes(earlier.read_bytes())
    monkeypatch.chdir(tmp_path)
    text_of(folder, "near.h5", 3)
    assert len(warm_start(load_campaign("campaigns/next.yaml")).strings) == 3
    text_of(folder, "far.h5", 3)
    with pytest.raises(CampaignError) as caught:
        warm_start(load_campaign("campaigns/next.yaml"))
    assert "campaigns/far.h5: No such file or directory; the name is relative to the folder" in str(
        caught.value
    )


def check(*words):
    return CliRunner().invoke(main, ["check", *map(str, words)])


def test_check_looks_at_the_earlier_file_as_a_run_does(earlier, ranked, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    text_of(tmp_path, "gone.h5", 3)
    done = check("next.yaml")
    assert done.exit_code == 2
    assert "search.start: gone.h5: No such file or directory" in done.stderr
    (tmp_path / "gone.h5").write_bytes(earlier.read_bytes())
    assert check("next.yaml").exit_code == 0
    lower, upper = without_best(ranked)
    text = text_of(tmp_path, "gone.h5", 3, size_ratio=f"[{lower}, {upper}]")
    (tmp_path / "next.yaml").write_text(text)
    assert "search.start: leaves out strings of gone.h5: " in check("next.yaml").stderr
    assert check("next.yaml", "--strict").exit_code == 2
    shown = []
    read_request(InvertOptions("next.yaml"), shown.append)
    assert any("leaves out strings of gone.h5" in line for line in shown)
    with pytest.raises(CampaignError, match="leaves out strings"):
        read_request(InvertOptions("next.yaml", strict=True))
