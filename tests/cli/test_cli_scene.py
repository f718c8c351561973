"""A file with a scene and fixed variables alone is checked and simulated, but not searched."""

import json

import pytest
from campaign_runs import QUICKSTART, invert

from agglom_mpi import load_campaign
from agglom_mpi.verbs.simulate import simulate

BOXES = (("[0.1, 30]", "4.3"), ("[0.4, 0.8]", "0.633"), ("[10 MPa, 200 MPa]", "67 MPa"))


@pytest.fixture
def scene(tmp_path):
    """Return a file with the quickstart's scene, and no word on a search."""
    text = QUICKSTART.read_text().partition("\nobjective")[0]
    for box, value in BOXES:
        assert box in text
        text = text.replace(box, value)
    path = tmp_path / "scene.yaml"
    path.write_text(text)
    return path


def test_a_scene_is_checked(agglom, scene):
    done = agglom("check", scene)
    assert (done.exit_code, done.stderr) == (0, "")
    headings = [line for line in done.stdout.splitlines() if not line.startswith(" ")]
    assert headings[1:] == ["Scene", "Variables", "What follows", "Submodels", "Left out"]
    assert "\n  a scene: nothing is searched, `agglom simulate` runs it\nScene\n" in done.stdout
    for entry in ("search", "ensemble", "generations", "strings", "samples"):
        assert f"  {entry}: " not in done.stdout


def test_a_scene_is_simulated(agglom, scene):
    done = agglom("simulate", scene, "--samples", 3, "--json")
    report = json.loads(done.stdout)
    outcomes = [simulate(load_campaign(scene), {}, sample) for sample in range(3)]
    mean = sum(outcome.mean_radius_ratio for outcome in outcomes) / 3
    assert done.exit_code == 0
    assert report["measured"]["mean_radius_ratio"]["mean"] == pytest.approx(mean, rel=1e-14)
    greatest = 100 ** (1 / 3)
    assert report["objective"]["mean"] == pytest.approx(1 - mean / greatest, rel=1e-12)
    assert outcomes[0].objective == pytest.approx(1 - outcomes[0].mean_radius_ratio / greatest)


@pytest.mark.parametrize("options", [[], ["--generations", "2"]])
def test_a_scene_is_not_searched(scene, options):
    done = invert(scene.parent, scene, *options)
    line = scene.read_text().splitlines().index("variables:") + 1
    assert done.returncode == 2
    assert done.stderr == (
        f"{scene}:{line}: variables: has no range; a search needs at least one variable as "
        "[lower, upper], and the sections objective, ensemble and stopping\n"
    )
    assert not list(scene.parent.glob("*.h5"))


@pytest.mark.parametrize("command", ["check", "simulate"])
@pytest.mark.parametrize(
    ("old", "new", "line", "expected"),
    [
        ("activation_energy: 707 J/mol", "activation_energy: 1e7 J/mol", "  end_time", "is 3637;"),
        ("half_width: 1 cm", "half_width: 1e60 cm", "  half_width", "has a mass that is not betw"),
        ("density: 6142", "density: 1e200", "  density", "is 1e+200; must be 0 or in size between"),
        ("size_ratio: 0.633", "size_ratio: 0.95", "  size_ratio", "at most 0.8986"),
        ("temperature: 330.7 K", "temperature: 0 K", "  temperature", "must be greater than 0 K"),
        ("particles: 100", "particles: 1", "  particles", "is 1; must be at least 2"),
        ("relative_speed: 4.3", "relative_speed: -1", "  relative_speed", "must be at least 0 m/s"),
    ],
)  # fmt: skip
def test_what_cannot_be_simulated_is_one_message(
    mistaken, scene, command, old, new, line, expected
):
    text = scene.read_text()
    assert text.count(old) == 1
    scene.write_text(text.replace(old, new))
    lines = scene.read_text().splitlines()
    [number] = [i for i, entry in enumerate(lines, 1) if entry.startswith(f"{line}:")]
    message = mistaken(command, scene)
    assert message.startswith(f"{scene}:{number}: ")
    assert expected in message
