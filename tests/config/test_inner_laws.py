"""A law within a law: its numbers, errors, identity and hardness, and one's own on both sides."""

import pytest
from click.testing import CliRunner
from own_components import SPEED
from plain_python import PLAIN_ALONE

from agglom_mpi import load_campaign, open_campaign
from agglom_mpi.cli.invert import invert_command
from agglom_mpi.config.campaign import Campaign
from agglom_mpi.config.identity import identity
from agglom_mpi.config.scene_paths import find_path, given_at, paths_of, with_number, with_numbers
from agglom_mpi.config.yaml_source import CampaignError
from agglom_mpi.physics.hardness import ArrheniusHardness, ConstantHardness
from agglom_mpi.verbs.simulate import simulate

TEXT = """\
seed: 1
scene:
  particles: 40
  grain_diameter: 1 um
  velocities: {law: spread, mean: [0, 0, 0], transverse: 1}
  restitution: {law: adhesive, dry: DRY, youngs_modulus: 54 GPa}
  heating: none
  end_time: 10 us
variables:
  relative_speed: [0.2, 1]
  volume_fraction: 0.05
  density: 2000
  surface_energy: 0.025
MORE
objective: {law: growth_target, ratio: 1.2}
search: {method: random, population: 4}
ensemble: {rule: fixed, samples: 2}
stopping: {generations: 1}
final: null
"""
RESTITUTION_LINE = 6

WRAPPER = '''
from agglom_mpi.components import Choice, solve_restitution


class Halved(Restitution):
    """Half of the rebound of another law."""

    inside: Annotated[Restitution, Choice(Restitution, is_inner=True)]
    factor: Annotated[float, In("1", above=0, at_most=1)] = 0.5
    summary: ClassVar[str] = "a part of the rebound of another law"

    def solve_restitution(self, laws, pair):
        """Return the rebound of the other law times a factor."""
        found = solve_restitution(self.inside, laws, pair)
        rest = 1.0 - self.factor * (1.0 - found.deficit)
        return RestitutionSolution(rest, found.bonds, 0.0, False)
'''
OWN = '{law: "sticking.py:SpeedRestitution", speed: 3 m/s, sticking: 0}'


def text(dry, more=""):
    return TEXT.replace("DRY", dry).replace("MORE\n", more)


def problems(dry):
    with pytest.raises(CampaignError) as caught:
        Campaign.from_text(text(dry))
    return [(each.line, each.field) for each in caught.value.problems]


@pytest.mark.parametrize(
    ("dry", "below"),
    [
        ("{law: constant, value: 2}", ".value"),
        ("{law: constant}", ".value"),
        ("{law: constant, value: 0.5, colour: 3}", ".colour"),
        ("{law: nonsense}", ".law"),
        ("nonsense", ""),
        ("3", ""),
        ("{law: adhesive, youngs_modulus: 1 GPa, dry: {law: constant, value: -1}}", ".dry.value"),
        ("{law: elastic_plastic, youngs_modulus: 1 GPa}", ".yield_stress"),
    ],
)
def test_what_is_wrong_with_an_inner_law_is_said_with_its_path(dry, below):
    assert problems(dry) == [(RESTITUTION_LINE, f"scene.restitution.dry{below}")]


def test_numbers_of_an_inner_law_are_searched_by_their_path():
    more = "  restitution.dry.value: [0.5, 0.9]\n"
    campaign = Campaign.from_text(text("{law: constant}", more))
    for value in (0.5, 0.75):
        section = campaign.at(campaign.parameters({"restitution.dry.value": value})).section
        assert section.restitution.dry.value == value
        assert section.restitution.youngs_modulus == 54e9
    assert "value as in variables" in campaign.describe()


def test_a_number_of_an_inner_law_stands_in_one_place():
    more = "  restitution.dry.value: [0.5, 0.9]\n"
    with pytest.raises(CampaignError) as caught:
        Campaign.from_text(text("{law: constant, value: 0.7}", more))
    assert [each.field for each in caught.value.problems] == ["variables.restitution.dry.value"]


def test_a_number_is_put_into_the_law_that_has_it():
    scene = {
        "restitution": {
            "law": "wet",
            "dry": {"law": "adhesive", "dry": {"law": "constant"}, "youngs_modulus": 1e9},
        }
    }
    path = find_path("restitution.dry.dry.value", scene)
    assert given_at(scene, path) is None
    assert {"restitution.viscosity", "restitution.dry.youngs_modulus"} <= set(paths_of(scene))
    found = with_number(scene, path, 0.25)
    assert found["restitution"]["dry"]["dry"] == {"law": "constant", "value": 0.25}
    assert given_at(found, path) == ("restitution", "dry", "dry", "value")


def test_numbers_that_laws_refuse_together_are_refused_inside_too():
    more = "  restitution.dry.film_thickness: [LOW um, 3 um]\n"
    wet = "{law: wet, dry: {law: constant, value: 0.9}, viscosity: 0.1, roughness: 3 um}"
    with pytest.raises(CampaignError) as caught:
        Campaign.from_text(text(wet, more.replace("LOW", "1")))
    [found] = caught.value.problems
    assert (found.line, found.field) == (14, "variables.restitution.dry.film_thickness")
    campaign = Campaign.from_text(text(wet, more.replace("LOW", "2")))
    [path] = campaign.variables.of_scene
    section = with_numbers(campaign.scene, {path: 2e-6})
    assert section.restitution.dry.film_thickness == 2e-6
    with pytest.raises(ValueError, match=r"restitution\.dry\.roughness"):
        with_numbers(campaign.scene, {path: 1e-6})


def test_the_identity_has_the_inner_law_with_its_numbers():
    one, other = (
        identity(Campaign.from_text(text(f"{{law: constant, value: {value}}}")))
        for value in (0.5, 0.75)
    )
    assert one["scene.restitution.dry.law"] == "constant"
    changed = {key for key in one if one[key] != other[key]}
    assert changed == {"scene.restitution.dry.value"}


def test_a_scene_needs_a_hardness_where_an_inner_law_does():
    more = "  hardness: 1 GPa\n  temperature: 300\n  activation_energy: 100\n"
    assert isinstance(Campaign.from_text(text("pressure", more)).scene.hardness, ArrheniusHardness)
    without = Campaign.from_text(text("{law: constant, value: 0.5}")).scene
    assert isinstance(without.hardness, ConstantHardness)
    assert without.impact_laws(dict.fromkeys(("surface_energy",), 1.0)).hardness is None


@PLAIN_ALONE
def test_contacts_last_in_a_scene_where_those_of_the_inner_law_do():
    dry = "{law: constant, value: 0.5, contact_time: 1 ns}"
    campaign = Campaign.from_text(text(dry))
    assert campaign.scene.restitution.keeps_last_impact
    outcome = simulate(campaign, {"relative_speed": 1.0}, 0)
    assert outcome.collisions > 0


def write(folder, dry, module=SPEED):
    (folder / "sticking.py").write_text(module)
    (folder / "own.yaml").write_text(text(dry))
    return folder / "own.yaml"


@pytest.mark.plain
def test_a_law_of_ones_own_is_the_dry_one(tmp_path):
    path = write(tmp_path, OWN)
    campaign = load_campaign(path, allow_code=True)
    assert campaign.scene.restitution.dry.speed == 3.0
    entries = identity(campaign)
    assert len(entries["scene.restitution.dry.source_sha256"]) == 64
    outcome = simulate(campaign, {"relative_speed": 1.0}, 0)
    assert outcome.record["momentum_error"] < 1e-12
    with pytest.raises(CampaignError) as caught:
        load_campaign(path)
    assert [each.field for each in caught.value.problems] == ["scene.restitution.dry.law"]


@PLAIN_ALONE
def test_a_law_of_ones_own_has_another_within_it(tmp_path):
    own = '{law: "sticking.py:Halved", inside: {law: constant, value: 0.8}}'
    path = write(tmp_path, own, SPEED + WRAPPER)
    campaign = load_campaign(path, allow_code=True)
    assert campaign.scene.restitution.dry.inside.value == 0.8
    assert simulate(campaign, {"relative_speed": 1.0}, 0).record["momentum_error"] < 1e-12


@pytest.mark.slow(guard="config/test_inner_laws.py::test_a_law_of_ones_own_is_the_dry_one")
def test_a_file_with_an_inner_law_of_ones_own_is_read_without_its_code(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    path = write(tmp_path, OWN)
    done = CliRunner().invoke(invert_command, [str(path), "--allow-code"])
    assert done.exit_code == 0, done.output
    path.unlink()
    (tmp_path / "sticking.py").unlink()
    assert len(open_campaign(tmp_path / "own.h5").strings) == 4
