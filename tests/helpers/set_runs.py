"""Small campaigns of the question which speeds, hardnesses and frictions double the grains."""

import re
from pathlib import Path

from campaign_runs import finish

JOB = Path(__file__).parents[2] / "jobs" / "doubling_in_three.yaml"


def three_variable_text(generations=14, **changed):
    """Return the job with fewer generations, and with other sections by name."""
    text = re.sub(r"generations: \d+", f"generations: {generations}", JOB.read_text())
    for name, value in changed.items():
        pattern = rf"(?m)^{name}: .*$"
        line = f"{name}: {value}"
        text = re.sub(pattern, line, text) if re.search(pattern, text) else f"{text}\n{line}\n"
    return text


def three_variable_file(folder, replaced=None, **options):
    """Run such a campaign, without estimates at its end; the path of its file.

    Parts of its text are `replaced`, a mapping.
    """
    options.setdefault("final", "none")
    text = three_variable_text(**options)
    for old, new in (replaced or {}).items():
        assert old in text
        text = text.replace(old, new)
    (folder / "three.yaml").write_text(text)
    finish(folder, "three.yaml")
    return folder / "three.h5"


def calibrated(found, coverage=0.9):
    """Return the calibration of a set as if its intervals held that share near the set."""
    [near, *others] = found.calibration.regions
    return found.calibration._replace(regions=[near._replace(coverage=coverage), *others])
