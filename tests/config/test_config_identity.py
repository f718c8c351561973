"""The identity holds what decides results, the description says what would run."""

import json
from typing import Annotated

import pytest
from campaign_text import campaign, constant

from agglom_mpi.config.campaign import Campaign
from agglom_mpi.declaration.declared import LATER, Declared


@pytest.mark.parametrize(
    "edit",
    [
        ("  hardness: [", "  hardness: [10 MPa, 0.2 GPa]"),
        ("  half_width", "  half_width: 1 cm"),
        ("  reaction_heat", "  reaction_heat: 1000000"),
        ("  temperature", "  temperature: 26.85 degC"),
        ("  restitution", "  # the default"),
        ("  cooling", "  cooling: {law: none}"),
        ("title", "title: Another name"),
        ("title", "output: {file: elsewhere.h5}"),
        ("title", "output: {final_particles: true, frames: {count: 5}}"),
        ("  generations", "  generations: 50"),
        ("  target", "  max_failures: 3"),
        ("  reaction_heat", "  reaction_heat: 1e6\n  surface_energy: 3"),
    ],
)
def test_the_same_campaign_has_the_same_identity(edit: tuple[str, str]) -> None:
    assert campaign(edit).identity() == campaign().identity()
    assert campaign(edit).sha256() == campaign().sha256()


@pytest.mark.parametrize(
    ("edit", "key"),
    [
        (("seed", "seed: 8"), "seed"),
        (("  particles", "  particles: 101"), "scene.particles"),
        (("  engine", "  engine: {law: fixed, steps: 51}"), "scene.engine.steps"),
        (("  engine", "  engine: event"), "scene.engine.budget"),
        (("  density", "  density: 6000.0000000001"), "variables.density.0"),
        (("objective", "objective: {law: growth_target, ratio: 2.5}"), "objective.ratio"),
        (("search", "search: {population: 14, parents: 4}"), "search.population"),
        (("  tolerance", "  tolerance: 2e-3"), "ensemble.tolerance"),
        (("  max_samples", "  max_samples: 21"), "ensemble.max_samples"),
        (("  target", "  target: {top: 2, objective: 1e-3}"), "stopping.target.top"),
    ],
)
def test_what_decides_results_is_in_the_identity(edit: tuple[str, str], key: str) -> None:
    ours, theirs = campaign().identity(), campaign(edit).identity()
    assert theirs[key] != ours.get(key)
    assert campaign(edit).sha256() != campaign().sha256()


def test_the_contact_time_is_in_the_identity() -> None:
    assert constant("1 us").identity()["scene.restitution.contact_time"] == 1e-6
    assert constant("0 s").sha256() == constant().sha256() != constant("1 us").sha256()


def test_an_identity_survives_json() -> None:
    identity = campaign().identity()
    assert json.loads(json.dumps(identity)) == identity
    assert identity["scene.particles"] == 100
    assert identity["variables.hardness.1"] == 2e8


def test_a_stored_text_gives_back_the_campaign() -> None:
    first = campaign()
    assert Campaign.from_text(first.text, "stored").identity() == first.identity()


def section(text: str, heading: str) -> str:
    lines = text.splitlines()
    begin = lines.index(heading) + 1
    end = next((i for i in range(begin, len(lines)) if lines[i][0] != " "), len(lines))
    return "\n".join(lines[begin:end])


def test_the_description_separates_used_from_left_out_submodels() -> None:
    text = campaign().describe()
    used, left_out = section(text, "Submodels"), section(text, "Left out")
    assert "restitution: pressure" in used
    assert "[A 6] [B 3.1, 4.13]" in used
    assert "hardness: arrhenius" in used
    assert left_out.splitlines()[:2] == ["  fragmentation", "  cooling"]


def test_constant_restitution_leaves_out_what_it_does_not_ask() -> None:
    left_out = [line.strip() for line in section(constant().describe(), "Left out").splitlines()]
    assert left_out[:-2] == ["duration", "hardness", "fragmentation", "cooling", "solver"]
    assert left_out[-2].startswith("particles do not record: time of last cooling, time of last ")
    assert left_out[-1].startswith("samples do not store: ")


@pytest.mark.parametrize(
    ("contact_time", "line"),
    [
        ("0", "the same in every impact; value 0.9"),
        (
            "2 us",
            "the same, but elastic within contact_time (s) of either's last impact; "
            "value 0.9, contact_time 2e-06 s",
        ),
    ],
)
def test_a_contact_time_is_described_where_there_is_one(contact_time: str, line: str) -> None:
    text = constant(contact_time).describe()
    assert f"  {'restitution: constant':<32}{line}\n" in text


def test_the_description_counts_strings_and_samples() -> None:
    text = campaign().describe()
    assert "strings: 44\n" in text
    assert "samples: 88 to 880, 2 to 20 per string" in text
    assert "125 [A] (tolerance 1e-5), 11.84 [B] (5e-4)" in text
    assert "volume fraction 0.0335 to 0.268" in text
    early = campaign(("  target", "  target: {top: 2, objective: 1e-3}")).describe()
    assert "strings: 12 to 44\n" in early


def test_the_description_lists_variables_with_units() -> None:
    edit = ("  reaction_heat", "  reaction_heat: 1e6\n  surface_energy: 3")
    rows = [line.split() for line in section(campaign(edit).describe(), "Variables").splitlines()]
    assert ["hardness", "Pa", "1e+07", "..", "2e+08"] in rows
    assert ["friction", "0.3", "(fixed)"] in rows
    assert ["surface_energy", "J/m^2", "ignored:", "nothing", "depends", "on", "it"] in rows


@pytest.mark.parametrize(
    ("edit", "expected"),
    [
        (("objective", "objective: maximum_growth"), "|1 - mean radius ratio / N^(1/3)| [B 7.1]"),
        (("  rule", "  rule: moments"), "no moment up to 4 by more than 0.001"),
        (("  rule", "  rule: standard_error"), "half the 95 % interval of the objective is at mos"),
        (
            ("  rule", "  rule: successive_difference\n  quantity: mean_radius"),
            "radius by less",
        ),
        (("  engine", ""), "event-driven, exact times, at most 20,000 events per grain\n"),
        (("  engine", "  engine: {law: event, budget: 5}"), "at most 5 events per grain\n"),
        (("  engine", "  engine: {law: fixed, steps: 60}"), "engine: 60 equal steps [A]\n"),
        (("  engine", "  engine: adaptive"), "adaptive steps, 1e-06 to 0.001 s [B 6.14]"),
        (("  end_time", "  end_time: 10 ms"), "end time: 0.01 s"),
        (("search", "search: {rescale: {every: 4, factor: 0.5}}"), "every 4 generations shrunk by"),
    ],
)
def test_the_description_says_how_it_would_run(edit: tuple[str, str], expected: str) -> None:
    assert expected in campaign(edit).describe()


@pytest.mark.parametrize(
    ("output", "stored", "absent"),
    [
        ("{frames: none}", [], "single particles, states before the end"),
        (
            "{final_particles: true}",
            ["of every sample: its final particles, 3.2 kB"],
            "states before the end",
        ),
        (
            "{frames: {count: 50}}",
            ["of 1 sample of each of the best 6 strings: 50 frames, 2.64 MB in all"],
            "single particles",
        ),
        (
            "{final_particles: true, frames: {count: 1, strings: 1, samples: 3}}",
            [
                "of every sample: its final particles, 3.2 kB",
                "of 3 samples of the best string: 1 frame, 0.0264 MB in all",
            ],
            None,
        ),
        (  # 5 generations of at most 44 strings in all, of at most 20 samples
            "{frames: {count: 2, strings: 100, samples: 100}}",
            ["of 20 samples of each of the best 44 strings: 2 frames, 15.5 MB in all"],
            "single particles",
        ),
    ],
)
def test_what_is_stored_of_a_sample_is_described_with_its_size(
    output: str, stored: list[str], absent: str | None
) -> None:
    lines = campaign(("title", f"output: {output}")).describe().splitlines()
    found = [line.removeprefix("  stored ") for line in lines if line.startswith("  stored ")]
    assert found == stored
    left_out = [
        line.partition(": ")[2] for line in lines if line.startswith("  samples do not store")
    ]
    assert left_out == ([] if absent is None else [absent])


class Later(Declared):
    old: int = 1
    new: Annotated[int, LATER] = 2


class Around(Declared):
    inner: Later = Later()


def test_a_field_added_later_is_an_entry_only_if_it_is_asked_for() -> None:
    assert Around().entries() == {"inner": {"old": 1}}
    assert Around(inner=Later(new=3)).entries() == {"inner": {"old": 1, "new": 3}}
