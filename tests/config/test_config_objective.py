"""The objective section: moments that are wanted, and a function that is run only if allowed."""

import pickle
from pathlib import Path

import pytest
from campaign_text import campaign, edited

from agglom_mpi.config.campaign import Campaign
from agglom_mpi.config.loading import check_campaign, load_campaign
from agglom_mpi.config.user_function import UserFunction, evaluate, load_function, recorded_function
from agglom_mpi.config.yaml_source import CampaignError
from agglom_mpi.declaration.own_modules import OwnModule

FUNCTION = "objective: {law: function, call: 'shape:worth'}"
LINE = edited().splitlines().index("objective: {law: growth_target, ratio: 2}") + 1


def message(objective: str) -> str:
    with pytest.raises(CampaignError) as caught:
        campaign(("objective", objective))
    text = str(caught.value)
    assert "\n" not in text
    return text.removeprefix("campaign.yaml:")


def moments(rest: str) -> str:
    return f"objective: {{law: moments, {rest}}}"


WRONG = [
    ("objective: moments", ("objective.targets:", "is missing", "2", "0.4")),
    (moments("targets: {}"), ("objective.targets:", "at least")),
    (moments("targets: 2"), ("objective.targets:", "is 2", "a mapping")),
    (moments("targets: {mean: }"), ("objective.targets.mean:", "is empty")),
    (moments("targets: {mean: 0.5}"), ("objective.targets.mean:", "is 0.5", "at least 1")),
    (moments("targets: {mean: 5}"), ("objective.targets.mean:", "is 5", "100", "4.642")),
    (moments("targets: {spread: -1}"), ("objective.targets.spread:", "is -1", "at least 0")),
    (moments("targets: {spread: .nan}"), ("objective.targets.spread:", "is nan")),
    (moments("targets: {second: -1}"), ("objective.targets.second:", "is -1", "at least 0")),
    (moments("targets: {fourth: -1}"), ("objective.targets.fourth:", "is -1", "at least 0")),
    (moments("targets: {kurtosis: 0.9}"), ("objective.targets.kurtosis:", "is 0.9", "at least")),
    (
        moments("targets: {kurtosis: 3, skewness: 2}"),
        ("objective.targets.kurtosis:", "is 3", "2", "5", "at least 1"),
    ),
    (moments("targets: {skewnes: 1}"), ("objective.targets.skewnes:", "unknown key 'skewnes'")),
    (moments("targets: {skewness: much}"), ("objective.targets.skewness:", "is the text 'much'")),
    (
        moments("targets: {mean: 2}, weights: {spread: 2}"),
        ("objective.weights.spread:", "is the weight of no target"),
    ),
    (moments("targets: {mean: 2}, weights: {mean: 0}"), ("weights.mean:", "is 0")),
    (
        moments("targets: {mean: 2}, ratio: 2"),
        ("objective.ratio:", "unknown key 'ratio'", "allowed: law"),
    ),
    ("objective: function", ("objective.call:", "is missing")),
    ("objective: {law: function, call: }", ("objective.call:", "is empty")),
    (
        "objective: {law: function, call: worth}",
        ("objective.call:", "is 'worth'"),
    ),
    ("objective: {law: function, call: 'a.b:c'}", ("objective.call:", "is 'a.b:c'")),
    ("objective: {law: function, call: '../a:c'}", ("objective.call:", "is '../a:c'")),
    ("objective: {law: function, call: 'a:b:c'}", ("objective.call:", "is 'a:b:c'")),
    ("objective: {law: function, call: 'if:b'}", ("objective.call:", "is 'if:b'")),
]


@pytest.mark.parametrize(("objective", "expected"), WRONG)
def test_what_is_wrong_is_said_with_line_and_field(
    objective: str, expected: tuple[str, ...]
) -> None:
    said = message(objective)
    assert said.startswith(f"{LINE}: ")
    assert all(part in said for part in expected)


def test_weights_are_one_unless_given_and_both_decide_results() -> None:
    given = campaign(
        ("objective", moments("targets: {spread: 0.4, mean: 2}, weights: {spread: 1}"))
    )
    default = campaign(("objective", moments("targets: {mean: 2, spread: 0.4}")))
    assert given.identity() == default.identity()
    entries = {k: v for k, v in default.identity().items() if k.startswith("objective.")}
    assert entries == {
        "objective.law": "moments",
        "objective.targets.mean": 2.0,
        "objective.targets.spread": 0.4,
        "objective.weights.mean": 1.0,
        "objective.weights.spread": 1.0,
    }
    heavy = campaign(("objective", moments("targets: {mean: 2, spread: 0.4}, weights: {mean: 2}")))
    assert heavy.sha256() != default.sha256()
    assert "mean 2 (weight 2), spread 0.4 [A 29]" in heavy.describe()


def test_the_old_laws_are_what_they_were_to_the_byte() -> None:
    target = {k: v for k, v in campaign().identity().items() if k.startswith("objective")}
    assert target == {"objective.law": "growth_target", "objective.ratio": 2.0}
    most = campaign(("objective", "objective: maximum_growth")).identity()
    assert {k for k in most if k.startswith("objective")} == {"objective.law"}
    digest = "01f795b36c25d0a3af7cc1e59e96a63a60fcf053aa4e096f649bdd16747384f8"  # of version 0.1.0
    assert campaign().sha256() == digest


def test_only_a_function_may_be_wanted_below_zero() -> None:
    edit = ("  target", "  target: {top: 2, objective: -1}")
    with pytest.raises(
        CampaignError, match=r"stopping.target.objective: is -1; must be at least 0"
    ):
        campaign(edit)
    assert campaign(("objective", FUNCTION), edit).stopping.target.objective == -1.0


@pytest.fixture
def written(tmp_path: Path) -> Path:
    """Return a campaign file whose objective is a function of a module that leaves traces."""
    trace = tmp_path / "trace"
    source = f"open({str(trace)!r}, 'a').write('x')\ndef worth(sample): return 1.5\n"
    (tmp_path / "shape.py").write_text(source)
    (tmp_path / "own.yaml").write_text(edited(("objective", FUNCTION)))
    return tmp_path / "own.yaml"


def problem(path: Path, allow_code: bool = True) -> str:
    with pytest.raises(CampaignError) as caught:
        load_campaign(path, allow_code)
    text = str(caught.value)
    assert "\n" not in text
    place = f"{path}:{LINE}: objective.call: is 'shape:worth', "
    assert text.startswith(place)
    return text.removeprefix(place)


def test_code_that_is_not_allowed_is_not_run_and_the_option_is_named(written: Path) -> None:
    assert "--allow-code" in problem(written, allow_code=False)
    assert not (written.parent / "trace").exists()


def test_a_check_reads_the_code_but_cannot_run_it(written: Path) -> None:
    checked, allowed = check_campaign(written), load_campaign(written, allow_code=True)
    assert (written.parent / "trace").read_text() == "x"
    assert checked.identity() == allowed.identity()
    assert (
        f"mean over samples of shape:worth (SHA-256 {allowed.user_function.module.sha256[:16]})"
        in (checked.describe())
    )
    with pytest.raises(ValueError, match="the source of 'shape:worth' is not known here"):
        evaluate(checked.user_function, None)
    assert (
        recorded_function(allowed.identity())
        == checked.user_function
        == allowed.user_function.without_source
    )


def test_a_campaign_from_text_alone_does_not_know_its_function() -> None:
    with pytest.raises(CampaignError, match="a function whose source was not read"):
        campaign(("objective", FUNCTION)).identity()


def test_a_change_of_the_source_is_another_campaign(written: Path) -> None:
    before = load_campaign(written, allow_code=True)
    source = written.parent / "shape.py"
    source.write_text(source.read_text() + "# a remark\n")
    after = load_campaign(written, allow_code=True)
    assert before.identity().keys() == after.identity().keys()
    different = {k for k, v in before.identity().items() if after.identity()[k] != v}
    assert different == {"objective.source_sha256"}


@pytest.mark.parametrize(
    ("source", "expected"),
    [
        (None, "shape.py cannot be read: No such file or directory"),
        ("def worth(sample)\n", "shape.py:1: expected ':'"),
        ("\0", "shape.py: source code string cannot contain null bytes"),
        ("import not_there_at_all", "but shape.py:1 raises ModuleNotFoundError: No module named"),
        ("raise SystemExit(3)", "but shape.py raised SystemExit, which would end a rank"),
        ("def other(sample): return 1.0", "but shape.py defines no function 'worth'"),
        ("worth = 1.0", "but shape.py defines no function 'worth'"),
        ("", "but shape.py defines no function 'worth'"),
    ],
)
def test_code_that_cannot_be_used_is_said_in_one_line(
    written: Path, source: str | None, expected: str
) -> None:
    path = written.parent / "shape.py"
    path.unlink()
    if source is not None:
        path.write_text(source)
    assert expected in problem(written)


def test_the_code_travels_with_the_campaign_and_is_not_read_again(written: Path) -> None:
    loaded = load_campaign(written, allow_code=True)
    (written.parent / "shape.py").unlink()
    arrived: Campaign = pickle.loads(pickle.dumps(loaded))
    assert evaluate(arrived.user_function, None) == 1.5


def code(body: str) -> UserFunction:
    source = f"def worth(sample):\n    {body}\n".encode()
    return UserFunction("shape:worth", OwnModule("shape.py", body, source))


@pytest.mark.parametrize(
    ("body", "error", "said"),
    [
        ("return True", TypeError, "shape:worth returned True, of type bool; must be a number"),
        ("return '1'", TypeError, "returned '1', of type str; must be a number"),
        ("return 1j", TypeError, "returned 1j, of type complex; must be a number"),
        ("return None", TypeError, "returned None, of type NoneType; must be a number"),
        ("return [1.0] * 9999", TypeError, r"returned \[1.0, 1.0, .*\.\.\.\], of type list; must"),
        ("return 10**400", ValueError, r"returned 1000+\.\.\.0+; must be finite"),
        ("import numpy; return numpy.bool_(True)", TypeError, "of type bool"),
        ("import numpy; return numpy.float32('inf')", ValueError, "must be finite"),
        ("return float('nan')", ValueError, "returned nan; must be finite, and in size at most"),
        ("return -float('inf')", ValueError, "returned -inf; must be finite"),
        ("return 2e100", ValueError, r"returned 2e\+100; must be finite, and in size at most"),
        ("raise KeyError('colour')", KeyError, "colour"),
        ("raise SystemExit", RuntimeError, "shape:worth raised SystemExit, which would end a rank"),
    ],
)
def test_what_is_no_finite_float_is_an_error(body: str, error: type, said: str) -> None:
    with pytest.raises(error, match=said):
        evaluate(code(body), None)


@pytest.mark.parametrize(
    ("value", "wanted"),
    [
        ("3", 3.0),
        ("-2", -2.0),
        ("numpy.float64(0.25)", 0.25),
        ("numpy.float32(0.25)", 0.25),
        ("numpy.int64(7)", 7.0),
        ("numpy.uint8(7)", 7.0),
    ],
)
def test_a_number_of_any_kind_is_a_float(value: str, wanted: float) -> None:
    found = evaluate(code(f"import numpy; return {value}"), None)
    assert type(found) is float
    assert found == wanted


def test_a_module_may_use_dataclasses_and_is_executed_once() -> None:
    source = b"""from __future__ import annotations
from dataclasses import dataclass
calls = []
@dataclass
class Wanted:
    mean: float
def worth(sample):
    calls.append(sample)
    return float(len(calls)) + Wanted(2.0).mean
"""
    own = UserFunction("shape:worth", OwnModule("shape.py", "dataclasses", source))
    assert [evaluate(own, None), evaluate(own, None)] == [3.0, 4.0]
    assert load_function(own) is load_function(UserFunction(*own))
