import json
import re

import pytest
from campaign_runs import QUICKSTART, invert, write_campaign

JOBS = sorted(QUICKSTART.parent.glob("*.yaml"))


@pytest.mark.parametrize("job", JOBS, ids=lambda job: job.stem)
def test_every_job_is_valid_and_says_what_would_run(agglom, job):
    done = agglom("check", job)
    assert done.exit_code == 0
    assert done.stderr == ""
    headings = [line for line in done.stdout.splitlines() if not line.startswith(" ")]
    headings = [heading for heading in headings if heading not in ("Constraints", "Properties")]
    assert headings[1:] == ["Scene", "Variables", "What follows", "Submodels", "Left out", "File"]
    for entry in ("seed", "objective", "ensemble", "generations", "strings", "samples", "engine"):
        assert f"\n  {entry}: " in done.stdout


def test_the_quickstart_says_how_much_it_is_and_what_it_leaves_out(agglom):
    text = agglom("check", QUICKSTART).stdout
    assert "\n  strings: 52\n" in text
    assert "\n  samples: 260 to 7,800, 5 to 150 per string\n" in text
    assert "\n  relative_speed    m/s     0.1 .. 30\n" in text
    text, _, size = text.partition("\nFile\n")
    assert size.startswith("  size: 4.56 MB")
    used, _, left_out = text.partition("\nSubmodels\n")[2].partition("\nLeft out\n")
    names = [line.split()[0].rstrip(":") for line in used.splitlines()]
    assert {"hardness", "friction", "reaction", "restitution"} <= set(names)
    assert left_out.splitlines() == [
        "  fragmentation",
        "  cooling",
        "  particles do not record: time of last cooling, time of last impact, number of grains",
        "  samples do not store: single particles, states before the end",
    ]


def test_the_campaign_on_the_page_of_jobs_prints_the_variables_shown_there(agglom, tmp_path):
    page = (QUICKSTART.parent / "README.md").read_text()
    section = page.partition("## Any number of the scene as a variable")[2]
    campaign, shown = re.findall(r"```(?:yaml)?\n(.*?)```", section, re.S)[:2]
    (tmp_path / "page.yaml").write_text(campaign)
    done = agglom("check", tmp_path / "page.yaml")
    assert (done.exit_code, done.stderr) == (0, "")
    assert f"\n{shown}" in done.stdout


def test_a_file_that_would_be_too_large_is_refused_before_it_is_made(mistaken, agglom, tmp_path):
    path = write_campaign(tmp_path / "large.yaml", generations=10**6, population=10**4)
    for command, *options in (["check"], ["check", "--json"]):
        said = mistaken(command, path, *options)
        assert said.startswith(f"{path}:37: stopping.generations: ")
    done = invert(tmp_path, "large.yaml")
    assert (done.returncode, done.stdout) == (2, "")
    assert done.stderr.startswith("large.yaml:37: stopping.generations: ")
    assert [found.name for found in tmp_path.iterdir() if "h5" in found.name] == [".large.h5.lock"]
    text = path.read_text().replace("population: 10000", "population: 4")
    path.write_text(text.replace("parents: 4", "parents: 2"))
    found = json.loads(agglom("check", "--json", path).stdout)
    assert found["file_bytes"] > 10**10


def test_a_wrong_key_is_named_with_its_line(mistaken, tmp_path):
    path = write_campaign(tmp_path / "bad.yaml")
    text = path.read_text().replace("  friction: restitution_scaled", "  frictoin: none")
    path.write_text(text)
    line = text.splitlines().index("  frictoin: none") + 1
    wanted = f"{path}:{line}: scene.frictoin: unknown key 'frictoin'; did you mean 'friction'?"
    assert mistaken("check", path) == wanted


def test_a_campaign_without_ranges_has_nothing_to_search(mistaken, tmp_path):
    path = write_campaign(tmp_path / "fixed.yaml")
    text = path.read_text()
    for box, value in (("[0.1, 30]", "1"), ("[0.4, 0.8]", "0.5"), ("[10 MPa, 200 MPa]", "1e8")):
        text = text.replace(box, value)
    path.write_text(text)
    assert "at least one variable as [lower, upper]" in mistaken("check", path)


def test_what_is_no_campaign_is_said_in_one_line(mistaken, tmp_path):
    assert mistaken("check", "nothing.yaml") == "nothing.yaml: no such file"
    assert "is a directory" in mistaken("check", tmp_path)


def test_a_campaign_may_come_from_a_pipe(agglom, mistaken, piped):
    text = QUICKSTART.read_text()
    assert agglom("check", piped(text)).stdout == agglom("check", QUICKSTART).stdout
    name = piped(text.replace("  friction: restitution_scaled", "  frictoin: none"))
    assert "scene.frictoin: unknown key" in mistaken("check", name).partition(f"{name}:")[2]
