"""The story from a question to a figure, told again: its commands work and print such lines.

The numbers are those of one kind of processor. On another the search goes other ways, and only what
has an error can be compared.
"""

import math
import re
import shutil
from pathlib import Path

import pytest
from campaign_runs import environment, need_mpirun
from processes import HANG, program

STORY = Path(__file__).parents[2] / "jobs" / "story"
STARTS = ("agglom ", "mpirun ", "python ")
LEFT_OUT = "agglom accuracy "
"""Takes minutes, and most of what it prints are times."""


def told():
    """Commands of the story, each with the lines that it shows of what they print."""
    blocks = re.findall(r"^```(\w*)\n(.*?)^```$", (STORY / "README.md").read_text(), re.M | re.S)
    pairs = []
    for _, block in (found for found in blocks[1:] if not found[0]):  # the first one sets up
        if block.startswith(STARTS):
            pairs.append((block.strip(), []))
        else:
            pairs[-1][1].extend(block.splitlines())
    return pairs


def carried_out(command, folder):
    env = environment(MPLBACKEND="Agg", COLUMNS="160")
    with program(["bash", "-c", command], cwd=folder, env=env) as process:
        printed, errors = process.communicate(timeout=4 * HANG)
    assert process.returncode == 0, errors
    return printed.splitlines()


def labels(lines):
    """What lines begin with, up to the first number; columns may have other widths."""
    return {" ".join(re.match(r"[^\d#]*", line)[0].split()) for line in lines}


def mean_radius(lines):
    """Mean of b/b0 and its standard error, as printed."""
    (line,) = (line for line in lines if "mean_radius_ratio" in line)
    return [float(number) for number in line.split()[1::2]]


@pytest.mark.slow
def test_the_commands_of_the_story_print_what_it_says(tmp_path):
    need_mpirun()
    for name in ("growth_by_half.yaml", "figure.py"):
        shutil.copy(STORY / name, tmp_path)
    commands = told()
    assert len(commands) == 7
    for command, lines in commands:
        if command.startswith(LEFT_OUT):
            continue
        printed = carried_out(command, tmp_path)
        assert labels(lines) <= labels(printed)
        if command.startswith("agglom simulate "):
            shown, error = mean_radius(lines)
            seen, other = mean_radius(printed)
            assert abs(seen - shown) <= 4.0 * math.hypot(error, other)
    assert (tmp_path / "growth_by_half.png").stat().st_size > 10_000
