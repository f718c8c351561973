"""`dir` and `help` of what users meet list the public names alone, with readable signatures."""

import doctest
import inspect
import pickle
import pydoc
import re
from dataclasses import dataclass, fields
from pathlib import Path

import pytest
from storage_rows import make

import agglom_mpi
from agglom_mpi import campaign_runs
from agglom_mpi.campaign_file import CampaignFile
from agglom_mpi.config.campaign import PUBLIC, Campaign
from agglom_mpi.inference.emulator_file import CampaignEmulator
from agglom_mpi.inference.feasible_set import SET_INTERNALS, FeasibleSet
from agglom_mpi.public_face import PublicFace
from agglom_mpi.simulation.sample import Outcome
from agglom_mpi.storage.reader import CampaignData
from agglom_mpi.verbs import searcher as searcher_module
from agglom_mpi.verbs.estimate import StringEstimate
from agglom_mpi.verbs.searcher import Searcher
from agglom_mpi.verbs.simulate_many import SimulatedSamples

ROOT = Path(__file__).parents[1]
PACKAGE = {"Box", "__version__", "compare_laws", "load_campaign", "load_emulator", "open_campaign"}
PLOTS = ("best", "busy", "cloud", "convergence", "cost", "ensembles", "finalists", "radii")
DATA_PLOTS = ("data_fit", "growth", "posterior", "predictive", "next_measurement")
MORE_PLOTS = ("finite_size", "samples", "search_paths", "set")
FILE = {
    *("path", "title", "seed", "campaign_text", "status", "damaged"),
    *("strings", "samples", "estimates", "generations", "variables", "volumes", "limits"),
    *("best", "feasible_set", "final_particles", "framed", "frames", "posterior"),
    *(
        f"plot_{name}"
        for name in (*PLOTS, *DATA_PLOTS, "finite_size", "samples", "search_paths", "set")
    ),
}
BOX = {"advance", "particles", "reset", "set", "state", "time", "volume"}  # see test_box_inputs
METHODS_OF_CAMPAIGN = {
    *("allowed", "describe", "description", "identity", "parameters", "sha256"),
    *("in_volume", "warnings"),
}
VERBS = {
    *("simulate", "simulate_many", "estimate", "run", "searcher", "experiment"),
    "collision_kernels",
}
CAMPAIGN = {*METHODS_OF_CAMPAIGN, *VERBS, "title", "seed", "text", "name"}
METHODS_OF_SET = {
    *("bounds", "deviation", "directions", "expected_error", "failing", "inner", "maximum"),
    *("mean", "noise", "outer", "posterior", "probability", "sample", "variables", "volume"),
    *("certificate", "empty", "nearest", "volume_error"),
}
SET = {*METHODS_OF_SET, "allowed", "calibration", "criterion", "samples", "strings", "tolerance"}
OUTCOME = {
    *("mean_radius_ratio", "objective", "particles", "radii", "temperatures", "moments"),
    *("ledger", "collisions", "merges", "breakups", "steps", "seconds", "cpu_seconds", "record"),
    *("final", "frames", "quantities"),
}
EMULATOR = {"deviation", "mean", "probability"}
FACES = {
    agglom_mpi.Box: BOX,
    CampaignFile: FILE,
    Campaign: METHODS_OF_CAMPAIGN,
    campaign_runs.RunnableCampaign: {*METHODS_OF_CAMPAIGN, *VERBS},
    CampaignEmulator: EMULATOR,
    FeasibleSet: METHODS_OF_SET,
    Outcome: set(),
    Searcher: {"ask", "best", "is_finished", "tell", "why_finished"},
    SimulatedSamples: set(),
    StringEstimate: {"as_dict"},
}
"""Classes that users meet, with their public methods and properties."""

UNREADABLE = ("numpy._typing", "typing.", "ForwardRef", "Alias for field", "__", " at 0x")


@pytest.fixture(scope="module")
def campaign():
    return agglom_mpi.load_campaign(ROOT / "jobs" / "quickstart.yaml")


def help_of(thing):
    return pydoc.plaintext.document(thing)


def test_the_package_lists_its_public_names():
    assert dir(agglom_mpi) == sorted(PACKAGE)
    assert set(agglom_mpi.__all__) == PACKAGE
    assert all(hasattr(agglom_mpi, name) for name in dir(agglom_mpi))


@pytest.mark.parametrize("face", FACES)
def test_a_class_lists_its_public_names(face):
    assert set(dir(face)) == FACES[face]


def test_a_file_lists_its_public_names_and_no_rows(tmp_path):
    file = agglom_mpi.open_campaign(make(tmp_path / "grains.h5"))
    assert set(dir(file)) == FILE
    assert all(getattr(file, name).__doc__ for name in FILE if name.startswith("plot_"))
    assert str(inspect.signature(file.plot_radii)) == "(string=None, ax=None)"
    rows = {"string_rows", "all_sample_rows", "legs", "derived", "snapshot", "attributes"}
    assert all(not hasattr(file, name) for name in rows)
    assert not isinstance(file, CampaignData)


def test_a_campaign_and_an_outcome_list_their_public_names(campaign):
    assert set(dir(campaign)) == CAMPAIGN
    outcome = campaign.simulate({"relative_speed": 0.1, "hardness": "200 MPa"})
    assert set(dir(outcome)) == OUTCOME
    estimate = campaign.estimate({"relative_speed": 0.1, "hardness": "200 MPa"}, samples=2)
    assert set(dir(estimate)) == {"as_dict", *(field.name for field in fields(StringEstimate))}
    again = pickle.loads(pickle.dumps(outcome))
    assert set(dir(again)) == OUTCOME
    assert again.record == outcome.record


def test_a_set_lists_its_public_names():
    found = object.__new__(FeasibleSet)
    attributes = {*SET - METHODS_OF_SET, *SET_INTERNALS, "_members"}
    vars(found).update(dict.fromkeys(attributes))
    assert set(dir(found)) == SET


@pytest.mark.parametrize(("face", "stated"), [(Campaign, PUBLIC), (FeasibleSet, SET_INTERNALS)])
def test_what_is_stated_of_a_face_exists(face, stated):
    attributes = {name for base in face.__mro__ for name in base.__dict__}
    attributes |= set(getattr(face, "__dataclass_fields__", ()))
    set_later = {"emulated", "points"}
    assert set(stated) - attributes == (set_later if face is FeasibleSet else set())


@pytest.mark.parametrize("face", FACES)
def test_help_of_a_class_shows_its_public_names_and_nothing_else(face):
    text = help_of(face)
    assert [word for word in UNREADABLE if word in text] == []
    assert max(map(len, text.splitlines())) < 160
    members = text.partition(" defined here:\n")[2]
    entries = re.findall(r"^ \|  (\w+)(?:\(.*\))?(?: = .*)?$", members, re.MULTILINE)
    assert set(entries) == FACES[face]


@pytest.mark.parametrize("face", FACES)
def test_every_public_name_is_described(face):
    for name in FACES[face]:
        assert inspect.getdoc(getattr(face, name)), name
    assert face.__doc__


def test_help_of_the_entry_points_is_readable():
    for function in (agglom_mpi.open_campaign, agglom_mpi.load_campaign, agglom_mpi.load_emulator):
        text = help_of(function)
        assert [word for word in UNREADABLE if word in text] == []
        assert max(map(len, text.splitlines())) < 140
        for heading in ("Parameters", "Returns", "Raises", "Examples"):
            assert f"    {heading}\n    ---" in text


def test_the_names_in_help_of_the_package_exist(campaign):
    listed = re.findall(r"^    ( *)(\.?\w+)\(.*?\) {2,}\S", agglom_mpi.__doc__, re.MULTILINE)
    assert len(listed) == 12
    owners = {"load_campaign": campaign, "open_campaign": CampaignFile}
    for indent, name in listed:
        if not indent:
            assert callable(getattr(agglom_mpi, name))
            owner = owners.get(name)
        else:
            assert callable(getattr(owner, name.removeprefix(".")))
    assert all(f"{name}(" in help_of(agglom_mpi) for _, name in listed)


def test_what_is_shown_of_an_object_is_one_short_line(campaign, finished):
    box = agglom_mpi.Box(campaign)
    searcher = campaign.searcher()
    shown = [
        (campaign, ("100 grains", "hardness by genetic")),
        (campaign.estimate({}, samples=3), ("3 samples", "mean_radius_ratio ")),
        (agglom_mpi.open_campaign(finished), ("finished", "3 generations")),
        (box, ("particles at 0 s",)),
        (searcher, ("0 generations judged",)),
    ]
    for thing, parts in shown:
        text = repr(thing)
        assert all(part in text for part in parts), text
        assert len(text) < 250
        assert not [word for word in (*UNREADABLE, "\n") if word in text]
    strings = searcher.ask()
    for thing in (strings, campaign.simulate_many(strings)):
        assert "12 strings" in repr(thing)
        assert len(repr(thing)) < 160


def test_a_file_that_is_gone_is_still_shown(tmp_path):
    file = agglom_mpi.open_campaign(make(tmp_path / "grains.h5"))
    file.path.unlink()
    assert "grains.h5" in repr(file)


def test_help_of_a_box_begins_with_how_it_is_made():
    signature = inspect.signature(agglom_mpi.Box)
    assert str(signature) in help_of(agglom_mpi.Box)
    assert str(signature).startswith("(campaign, parameters=None, *, radii=None, velocities=None,")


@pytest.mark.parametrize("module", [campaign_runs, searcher_module])
def test_the_examples_of_a_campaign_are_true(module, monkeypatch, tmp_path):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "jobs").symlink_to(ROOT / "jobs")
    tried = doctest.testmod(module)
    assert tried.failed == 0
    assert tried.attempted > 2


def test_a_public_face_keeps_what_python_needs():
    @dataclass(frozen=True)
    class Point(metaclass=PublicFace, internal=["shifted"]):
        x: float

        def moved(self, by: float = 1.0) -> "Point":
            """Return another point."""
            return self.shifted(by)

        def shifted(self, by: float) -> "Point":
            return Point(self.x + by)

        @classmethod
        def origin(cls) -> "Point":
            """Return the origin."""
            return cls(0.0)

    point = Point.origin()
    assert dir(Point) == ["moved", "origin"]
    assert dir(point) == ["moved", "origin", "x"]
    assert point.moved(2.0) == point.shifted(2.0) == Point(2.0)
    assert str(inspect.signature(Point.moved)) == "(self, by=1.0)"
    assert str(inspect.signature(point.moved)) == "(by=1.0)"
    assert str(inspect.signature(Point)) == "()"
    assert Point.moved.__annotations__ == {"by": float, "return": "Point"}
