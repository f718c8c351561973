"""A command that is given a file of another kind says what it is, and what reads it."""

import shutil

import pytest

from agglom_mpi import load_campaign, open_campaign
from agglom_mpi.cli.invert import invert_command
from agglom_mpi.config.yaml_source import MAX_BYTES, CampaignError
from agglom_mpi.storage.access import NotACampaign


@pytest.fixture
def large(tiny_folder, tmp_path):
    """Return a campaign file that is larger than a campaign's text may be."""
    path = shutil.copy(tiny_folder / "tiny.h5", tmp_path / "large.h5")
    with path.open("ab") as file:
        file.truncate(2 * MAX_BYTES)
    return path


@pytest.mark.parametrize("command", [["plan"], ["compile"], ["accuracy", "--out", "study"]])
def test_a_campaign_file_in_place_of_a_campaign_is_named_whatever_its_size(
    mistaken, large, tmp_path, command
):
    for path in ("tiny.h5", large, shutil.copy(large, tmp_path / "renamed.yaml")):
        message = mistaken(*command, path)
        assert message.startswith(f"{path}: is an HDF5 file, not YAML; agglom report, check, ")


def test_a_run_of_a_campaign_file_is_refused_by_its_kind(agglom, large):
    from click.testing import CliRunner

    done = CliRunner().invoke(invert_command, [str(large)])
    assert done.exit_code == 2
    assert f"{large}: is an HDF5 file, not YAML; agglom report" in done.stderr
    with pytest.raises(CampaignError, match="is an HDF5 file"):
        load_campaign(large)


@pytest.mark.parametrize(
    "words",
    [
        ["report", "tiny.yaml"],
        ["report", "tiny.h5", "tiny.yaml"],
        ["export", "tiny.yaml", "--csv", "tables"],
        ["plan", "tiny.yaml", "--from", "tiny.yaml"],
    ],
)
def test_a_campaign_in_place_of_its_file_is_named(mistaken, words):
    message = mistaken(*words)
    assert message.startswith("tiny.yaml: not an HDF5 file; it reads like a campaign in YAML: ")
    assert "agglom-invert runs it" in message


def test_from_python_a_campaign_in_place_of_its_file_is_named(tiny_folder):
    with pytest.raises(NotACampaign, match="it reads like a campaign in YAML"):
        open_campaign(tiny_folder / "tiny.yaml")


def test_a_campaign_file_in_place_of_diameters_is_named(mistaken, tiny_folder, large):
    text = (tiny_folder / "tiny.yaml").read_text()
    path = large.parent / "sized.yaml"
    path.write_text(text.replace("scene:\n", "scene:\n  sizes: {file: large.h5}\n", 1))
    assert "scene.sizes.file: is 'large.h5', an HDF5 file; must be a text" in mistaken(
        "check", path
    )
