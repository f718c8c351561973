"""What is unlikely is warned of, one line each with value, field and what is usual."""

from pathlib import Path

import pytest
from campaign_text import campaign, constant

from agglom_mpi.config.campaign import Campaign
from agglom_mpi.config.loading import load_campaign

JOBS = Path(__file__).parents[2] / "jobs"


def lines(loaded: Campaign, **given: float | str) -> list[str]:
    """Warnings, but for the one that no grains of this campaign are fast enough to bond."""
    found = [str(warning) for warning in loaded.warnings(given or None)]
    return [line for line in found if "duration.length_ratio" not in line]


def test_an_ordinary_campaign_is_not_warned_of() -> None:
    assert lines(campaign()) == []
    assert lines(campaign(), density="6 g/cm3", relative_speed=30, hardness="10 MPa") == []


WARNED = [
    ("  density", "  density: 2.5", "19: variables.density: is 2.5 kg/m^3; usual is from 20"),
    ("  density", "  density: [2, 3000]", "19: variables.density: reaches 2 kg/m^3; usual"),
    ("  hardness: [", "  hardness: 67", "20: variables.hardness: is 67 Pa; usual is from 1 kPa"),
    (
        "  hardness: [",
        "  hardness: [1e7, 2e13]",
        "20: variables.hardness: reaches 2e+13 Pa; usual is from 1 kPa, gels, to 150 GPa",
    ),
    (
        "  relative_speed",
        "  relative_speed: 20 km/s",
        "17: variables.relative_speed: is 20000 m/s; usual is from 1 µm/s to 10 km/s",
    ),
    ("  friction: 0", "  friction: 30", "22: variables.friction: is 30; usual is from 0 to 1"),
    (
        "  temperature",
        "  temperature: 30000",
        "23: variables.temperature: is 30000 K; usual is from 1 K to 4200 K",
    ),
    (
        "  half_width",
        "  half_width: 366",
        "5: scene.half_width: makes 100 grains of 126 m; usual are grains from 10 nm to 10 cm",
    ),
    (
        "  half_width",
        "  half_width: 1 nm",
        "5: scene.half_width: makes 100 grains of 172 pm; usual",
    ),
    (
        "  end_time",
        "  end_time: 1 us",
        "14: scene.end_time: ends before grains meet: 0.0",
    ),
    (
        "  reaction_heat",
        "  reaction_heat: 1\n  surface_energy: 5",
        "26: variables.surface_energy: is given, but nothing depends on it: the scene has no frag",
    ),
]


@pytest.mark.parametrize(("begin", "replacement", "expected"), WARNED)
def test_what_is_unlikely_is_one_line(begin: str, replacement: str, expected: str) -> None:
    found = lines(campaign((begin, replacement)))
    assert [line.startswith(f"campaign.yaml:{expected}") for line in found].count(True) == 1
    # Light grains bond at a high speed, at which the characteristic end time is short.
    assert len(found) == 1 or ("density: 2.5" in replacement and "scene.end_time" in found[0])


def test_values_that_are_given_are_warned_of_by_their_names() -> None:
    found = lines(campaign(), surface_energy=3, density=2.5, relative_speed=900)
    assert found[:2] == [
        "campaign.yaml: surface_energy: is 3, but nothing depends on it: the scene has no "
        "fragmentation and no adhesion",
        "campaign.yaml: density: is 2.5 kg/m^3; usual is from 20 kg/m^3, foams, to 22600, osmium",
    ]


def test_the_hardness_of_cold_grains_is_one_that_matter_has() -> None:
    fixed_time = ("  end_time", "  end_time: 1 ms")
    [line] = lines(campaign(("  activation", "  activation_energy: 0.7 MJ/mol"), fixed_time))
    assert line.startswith("campaign.yaml:24: variables.activation_energy: is 700000 J/mol")
    assert "10^130 Pa" in line  # 2e8 exp(7e5/(300 R))
    [line] = lines(campaign(("  activation", "  activation_energy: 1e9"), fixed_time))
    assert line.startswith("campaign.yaml:24: variables.activation_energy: is 1e+09 J/mol; usual")
    softer = ("  activation", "  activation_energy: 15 kJ/mol")
    assert not any("activation" in line for line in lines(campaign(softer, fixed_time)))


def spread(settings: str) -> tuple[str, str]:
    return "  velocities", f"  velocities: {{law: spread, {settings}}}"


@pytest.mark.parametrize(
    ("edit", "place"),
    [
        (spread("mean: [0, 0, 3e6 m/s]"), "6: scene.velocities.mean: makes speeds up to 3e+06 m/s"),
        (spread("transverse: 1e3"), "6: scene.velocities.transverse: is 1000, which makes speeds"),
        (
            ("  relative_speed", "  relative_speed: 3e6"),
            "17: variables.relative_speed: makes speeds",
        ),
    ],
)
def test_speeds_of_which_newton_knew_nothing(edit: tuple[str, str], place: str) -> None:
    found = lines(campaign(edit, ("  end_time", "  end_time: 1 ms")))
    assert any(line.startswith(f"campaign.yaml:{place}") for line in found)


def test_a_mean_flow_of_kilometres_per_second_is_that_of_a_projectile() -> None:
    assert lines(campaign(spread("mean: [0, 0, 20 km/s]"))) == []


def test_grains_that_are_too_slow_to_bond_are_told_the_speed() -> None:
    [line] = map(str, campaign().warnings())
    # sqrt(6 a_f H beta/rho) with a_f = 1, H = 10 MPa, beta = 1, rho = 6000 kg/m^3
    assert line.startswith("campaign.yaml:3: scene.duration.length_ratio: is 1: two grains ")
    assert "bond from 100 m/s on" in line
    assert "no more than 30 m/s" in line
    short = ("  contact_area", "  duration: {law: mean_speed, length_ratio: 1e-6}")
    assert campaign(short).warnings() == []
    assert not any(
        "length_ratio" in str(w)
        for w in campaign().warnings({"relative_speed": 60, "hardness": 1e7})
    )


def test_grains_at_rest_are_not_expected_to_meet() -> None:
    [line] = lines(campaign(), relative_speed=0)
    assert "0 collisions per grain are expected at most, where nothing moves" in line


def test_a_sample_of_hours_is_warned_of_where_each_collision_is_simulated() -> None:
    long = (("  end_time", "  end_time: 1e6 s"), ("  engine", "  engine: event"))
    [line] = lines(campaign(*long))
    assert "campaign.yaml:14: scene.end_time: makes a sample take" in line
    assert "unless grains bond or come to rest" in line
    [line] = lines(campaign(*long[:1]))
    assert "makes a sample take" not in line


def test_a_time_in_which_unstirred_grains_are_long_at_rest_is_warned_of() -> None:
    assert lines(campaign(("  end_time", "  end_time: 1 s"))) == []
    end = "  end_time: 1000 s"
    [line] = lines(campaign(("  end_time", end)))
    assert line.startswith("campaign.yaml:14: scene.end_time: lasts for ")
    assert not any("scene.end_time" in line for line in lines(constant(end_time="1000 s")))


def test_growth_is_out_of_reach_of_grains_that_never_bond() -> None:
    line = lines(constant())[-1]
    assert line.startswith("campaign.yaml:26: objective.ratio: wants a mean b/b0 of 2, but with a")
    assert "b/b0 stays 1" in line
    assert not any("objective" in line for line in lines(constant(value=0)))


@pytest.mark.parametrize("job", sorted(JOBS.glob("*.yaml")), ids=lambda job: job.stem)
def test_no_job_is_warned_of(job: Path) -> None:
    assert lines(load_campaign(job)) == []
