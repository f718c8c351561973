"""Values are SI float64s, whatever units and short forms they are written in."""

import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from campaign_text import campaign, constant, edited

from agglom_mpi.config.campaign import Campaign
from agglom_mpi.config.loading import campaign_of_record, load_campaign
from agglom_mpi.config.searchable import check_searchable
from agglom_mpi.config.yaml_source import CampaignError
from agglom_mpi.variables import TEN
from agglom_mpi.verbs.simulate import simulate

JOBS = Path(__file__).parents[2] / "jobs"
EVENT = {"law": "event", "budget": 20_000}


@pytest.mark.parametrize(
    ("text", "value"),
    [
        ("1 cm", 0.01),
        ("0.01", 0.01),
        ("7 um", 7e-6),
        ("7 µm", 7e-6),
        ("1e-2 m", 0.01),
        ("2km", 2000.0),
    ],
)
def test_lengths_are_converted_to_the_nearest_float(text: str, value: float) -> None:
    assert campaign(("  half_width", f"  half_width: {text}")).scene.half_width == value


@pytest.mark.parametrize(
    ("begin", "text", "value"),
    [
        ("  temperature", "60 degC", 333.15),
        ("  temperature", "60 °C", 333.15),
        ("  activation_energy", "0.35 kJ/mol", 350.0),
        ("  hardness: [", "67.188 MPa", 67.188e6),
        ("  hardness: [", "67 N/mm^2", 67e6),
        ("  friction: 0", "35 %", 0.35),
        ("  density", "2.5 g/cm^3", 2500.0),
        ("  density", "2.5 g/cm3", 2500.0),
        ("  density", "2500 kg/m3", 2500.0),
        ("  density", "2500 kg m-3", 2500.0),
        ("  hardness: [", "67 N/mm2", 67e6),
        ("  heat_capacity", "1 kJ/kg/K", 1000.0),
        ("  heat_capacity", "1 kJ/kg/degC", 1000.0),
        ("  heat_capacity", "1e3", 1000.0),
    ],
)
def test_variables_take_units(begin: str, text: str, value: float) -> None:
    name = begin.split(":")[0].strip()
    assert campaign((begin, f"  {name}: {text}")).variables.fixed[name] == value


@pytest.mark.parametrize("text", ["3e2", "300.0", "300"])
def test_a_whole_number_may_be_written_with_an_exponent(text: str) -> None:
    written = campaign(("  particles", f"  particles: {text}"))
    assert type(written.scene.particles) is int
    assert written.identity() == campaign(("  particles", "  particles: 300")).identity()


def test_short_and_long_forms_are_the_same() -> None:
    short = campaign(("  friction: c", "  friction: constant"), ("  cooling", "  cooling:"))
    long = campaign(("  friction: c", "  friction: {law: constant}"), ("  cooling", "  # none"))
    assert short.scene == long.scene
    assert long.scene.cooling.law == "none"


def test_defaults_fill_what_is_left_out() -> None:
    scene = campaign().scene
    assert scene.escape.name == "periodic"
    assert campaign(("  engine", "")).scene.engine.model_dump() == EVENT
    assert scene.fragmentation.law == "none"
    assert scene.solver.law == "root"
    assert campaign().search.blend == (0.0, 1.0)
    assert campaign().output.file is None
    assert campaign(("  rule", "  rule: standard_error")).ensemble.min_samples == 5


def test_constant_restitution_has_a_constant_hardness_by_default() -> None:
    scene = constant().scene
    assert scene.hardness.law == "constant"
    assert scene.end_time == 1e-3


def test_a_contact_time_takes_units_and_is_off_by_default() -> None:
    wanted = {"law": "constant", "value": 0.9, "contact_time": 0.0}
    assert constant().scene.restitution.model_dump() == wanted
    assert constant("2 us").scene.restitution.model_dump() == wanted | {"contact_time": 2e-6}


def test_variables_are_arrays_in_the_canonical_order() -> None:
    variables = campaign().variables
    assert variables.searched == ("relative_speed", "size_ratio", "hardness")
    assert variables.used == TEN.names[:-1]
    assert variables.lower[:4].tolist() == [0.1, 0.4, 6000.0, 1e7]
    assert variables.upper[:4].tolist() == [30.0, 0.8, 6000.0, 2e8]
    assert np.isnan(variables.lower[9])
    assert np.isnan(variables.upper[9])
    assert not variables.lower.flags.writeable


def test_a_fixed_value_that_nothing_uses_is_ignored() -> None:
    variables = campaign(("  reaction_heat", "  reaction_heat: 1\n  surface_energy: 5")).variables
    assert variables.ignored == ("surface_energy",)
    assert "surface_energy" not in variables.fixed


def test_without_heating_only_a_softening_hardness_needs_a_temperature() -> None:
    cold = (("  heating", "  heating: none"), ("  reaction: ", ""), ("  reaction_heat", ""))
    assert campaign(*cold).variables.ignored == ("heat_capacity",)
    hard = (("  hardness: a", "  hardness: constant"), *cold)
    ignored = ("heat_capacity", "temperature", "activation_energy")
    assert campaign(*hard).variables.ignored == ignored


def test_parameters_fill_ranges_and_keep_fixed_values() -> None:
    string = campaign().parameters({"hardness": "67 MPa", "density": 7000})
    assert string.dtype == np.float64
    assert string[:5].tolist() == [15.05, pytest.approx(0.6), 7000.0, 67e6, 1000.0]
    assert np.isnan(string[9])
    assert campaign().parameters(fill="upper")[0] == 30.0


def test_parameters_may_lie_outside_the_search_box() -> None:
    assert campaign().parameters({"relative_speed": np.float64(99)})[0] == 99.0


@pytest.mark.parametrize(
    ("values", "expected"),
    [
        ({"hardnes": 1.0}, "campaign.yaml: hardnes: unknown variable; did you mean 'hardness'?"),
        ({"speed": 1.0}, "campaign.yaml: speed: unknown variable; did you mean 'relative_speed'?"),
        ({"hardness": "1 K"}, "campaign.yaml: hardness: wrong unit: 'K' is temperature"),
        ({"size_ratio": 0.9}, "campaign.yaml: size_ratio: is 0.9; must be at most 0.8986"),
        ({"temperature": 0}, "campaign.yaml: temperature: is 0; must be greater than 0 K"),
        ({"density": float("nan")}, "campaign.yaml: density: is nan; must be a finite number"),
    ],
)
def test_impossible_parameters_are_refused(values: dict[str, float | str], expected: str) -> None:
    with pytest.raises(CampaignError) as caught:
        campaign().parameters(values)
    assert expected in str(caught.value)


def test_a_parameter_vector_must_have_ten_numbers() -> None:
    with pytest.raises(CampaignError, match=r"parameters: are .* of the shape \(3,\)"):
        simulate(campaign(), [1.0, 2.0, 3.0])


def test_engines_have_short_names() -> None:
    own = campaign()
    assert own.engine(None) is own.scene.engine
    assert own.engine("fixed") is own.scene.engine
    assert own.engine("fixed:2000").model_dump() == {"law": "fixed", "steps": 2000}
    adaptive = own.engine("adaptive")
    assert adaptive.model_dump() == {"law": "adaptive", "floor": 1e-6, "ceiling": 1e-3}
    assert own.engine(adaptive) is adaptive
    assert own.engine("event").model_dump() == EVENT
    assert own.engine(" event ").model_dump() == EVENT
    other = campaign(("  engine", "  engine: {law: adaptive, floor: 2 us}"))
    assert other.engine("fixed").model_dump() == {"law": "fixed", "steps": 200}
    assert other.engine("adaptive") is other.scene.engine
    third = campaign(("  engine", "  engine: {law: event, budget: 500}"))
    assert third.scene.engine.model_dump() == {"law": "event", "budget": 500}
    assert third.engine("event") is third.scene.engine
    assert third.engine("fixed").model_dump() == {"law": "fixed", "steps": 200}


@pytest.mark.parametrize(
    "text",
    ["", "fast", "fixed:", "fixed:0", "fixed:-3", "fixed:²", "adaptive:", "event:", "event:9"],
)
def test_nonsense_engines_are_refused(text: str) -> None:
    with pytest.raises(
        CampaignError, match=r"engine: is .*; allowed: event, fixed, fixed:STEPS, adaptive; STEPS"
    ):
        campaign().engine(text)


def test_a_campaign_without_a_range_cannot_be_searched() -> None:
    check_searchable(campaign())
    fixed = campaign(
        ("  relative_speed", "  relative_speed: 1"),
        ("  size_ratio", "  size_ratio: 0.5"),
        ("  hardness: [", "  hardness: 1e7"),
    )
    with pytest.raises(CampaignError, match=r"campaign\.yaml:16: variables: has no range"):
        check_searchable(fixed)


def test_more_generations_make_a_longer_campaign() -> None:
    assert campaign().max_strings == 12 + 4 * 8
    longer = campaign().with_generations(9)
    assert longer.stopping.generations == 9
    assert longer.max_strings == 12 + 8 * 8
    with pytest.raises(CampaignError, match=r"stopping\.generations: is 0; must be a whole number"):
        campaign().with_generations(0)


@pytest.mark.parametrize("job", sorted(JOBS.glob("*.yaml")), ids=lambda job: job.stem)
def test_every_job_loads_and_can_be_searched(job: Path) -> None:
    loaded = load_campaign(job)
    check_searchable(loaded)
    assert Campaign.from_text(loaded.text).sha256() == loaded.sha256()


def test_the_published_boxes_are_those_of_the_papers() -> None:
    a = load_campaign(JOBS / "accretion_2003.yaml").variables
    assert a.lower[:9].tolist() == [0.1, 0.4, 1e3, 1e7, 10, 0.01, 273.13, 10, 0]
    assert a.upper[:9].tolist() == [30, 0.8, 1e4, 2e8, 1500, 0.5, 373.13, 1000, 1e7]
    b = load_campaign(JOBS / "agglomeration_2004.yaml").variables
    assert b.lower.tolist() == [20, 0.4, 1e3, 1e5, 200, 1e-3, 100, 100, 1e6, 1e15]
    assert b.upper.tolist() == [200, 0.8, 1e4, 1e6, 2000, 1e-2, 1000, 1000, 1e7, 1e16]


def modules_after(code: str) -> set[str]:
    script = f"{code}\nimport sys; print(*sorted({{m.split('.')[0] for m in sys.modules}}))"
    run = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True)
    return set(run.stdout.split())


def test_plain_numbers_do_not_import_pint(tmp_path: Path) -> None:
    file = tmp_path / "plain.yaml"
    file.write_text(edited())
    load = f"from agglom_mpi import load_campaign; c = load_campaign({str(file)!r}); c.describe()"
    assert "pint" not in modules_after(load)
    assert "pint" in modules_after(f"{load}; c.parameters({{'hardness': '1 MPa'}})")


def test_loading_imports_nothing_heavy() -> None:
    job = str(JOBS / "accretion_2003.yaml")
    loaded = modules_after(f"from agglom_mpi import load_campaign; load_campaign({job!r})")
    assert not loaded & {"numba", "h5py", "mpi4py", "pandas", "matplotlib"}


@pytest.mark.parametrize(
    ("begin", "text"),
    [
        ("  temperature", "[20, 80 degC]"),
        ("  temperature", "[20 degC, 353]"),
        ("  temperature", "[250, 80 degF, log]"),
        ("  relative_speed", "[0.05, 20 cm/s]"),
        ("  relative_speed", "[5 cm/s, 20]"),
        ("  relative_speed", "[1 mm/s, 1, log]"),
        ("  size_ratio", "[0.4, 80 %]"),
        ("  density", "[1e99, 2 g/cm^3]"),
    ],
)
def test_a_unit_on_one_end_of_a_range_is_refused(begin: str, text: str) -> None:
    with pytest.raises(CampaignError, match="with a unit on one end alone"):
        campaign((begin, f"{begin}: {text}"))


@pytest.mark.parametrize(
    ("begin", "text", "ends"),
    [
        ("  relative_speed", "[0, 20 cm/s]", (0.0, 0.2)),
        ("  relative_speed", "[5, 20 m/s]", (5.0, 20.0)),
        ("  temperature", "[250, 400 K]", (250.0, 400.0)),
        ("  temperature", "[-5 degC, 20 degC]", (268.15, 293.15)),
        ("  density", "[1 g/cm^3, 4000 kg/m^3, log]", (1000.0, 4000.0)),
    ],
)
def test_a_range_takes_units_on_both_ends_or_where_they_change_nothing(
    begin: str, text: str, ends: tuple[float, float]
) -> None:
    box, i = campaign((begin, f"{begin}: {text}")).variables, TEN.names.index(begin.strip())
    assert (box.lower[i], box.upper[i]) == ends


def test_a_recorded_range_is_read_as_it_was_run() -> None:
    text = edited(("  relative_speed", "  relative_speed: [0.05, 20 cm/s]"))
    assert campaign_of_record(text, "old.h5", {}).variables.lower[0] == 0.05


@pytest.mark.parametrize(
    ("text", "value"),
    [("6.0D3", 6000.0), ("6.D+03 kg/m^3", 6000.0), ("6.0d0 g/cm^3", 6000.0), ("60E+2", 6000.0)],
)
def test_a_number_of_fortran_is_a_number(text: str, value: float) -> None:
    assert campaign(("  density", f"  density: {text}")).variables.fixed["density"] == value


@pytest.mark.parametrize(
    ("text", "remedy"),
    [
        ("2500,5", "a decimal point, and no comma"),
        ("2500,5 kg/m^3", "a decimal point, and no comma"),
        ("1,000.5", "a decimal point, and no comma"),
        ("2.5*10^3 kg/m^3", "a power of ten like 2.5e7"),
        ("2.5x10**3", "a power of ten like 2.5e7"),
        ("2.5·10³ kg/m^3", "a power of ten like 2.5e7"),
        ("6 000 kg/m^3", "without gaps"),
        ("6'000", "without gaps"),
        ("[2500,5, 6000,5]", "a decimal point, and no comma"),
    ],
)
def test_a_number_that_is_misspelt_is_refused_with_the_remedy(text: str, remedy: str) -> None:
    with pytest.raises(CampaignError, match=re.escape(remedy)):
        campaign(("  density", f"  density: {text}"))
