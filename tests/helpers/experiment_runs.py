"""A small campaign with three experiments, of which the last has no data."""

from measured_runs import MEASURED, SIEVE

_BEFORE, _, _AFTER = MEASURED.partition("data:")
_ENTRIES, _, _SECTIONS = _AFTER.partition("objective:")
SIZES, MEAN, LEFT = (line.strip() for line in _ENTRIES.strip().splitlines())
SHARED = _BEFORE.replace("  relative_speed: [0.01, 0.3, log]\n", "")
SLOW = f"  slow: {{variables: {{relative_speed: 0.05 m/s}}, data: [{SIZES[2:]}, {MEAN[2:]}]}}\n"
FAST = f"""\
  fast:
    variables: {{relative_speed: [0.1 m/s, 0.3 m/s]}}
    scene: {{end_time: 3 ms}}
    data: [{LEFT[2:]}]
"""
FASTER = "  faster: {variables: {relative_speed: 0.5 m/s}}\n"
THREE = SLOW + FAST + FASTER


def experiments_text(experiments=THREE, **changes):
    """Return the text of a campaign with these experiments, with parts of it replaced."""
    text = f"{SHARED}experiments:\n{experiments}objective:{_SECTIONS}"
    for old, new in changes.values():
        assert old in text
        text = text.replace(old, new)
    return text


def write_experiments(folder, experiments=THREE, name="experiments", **changes):
    """Write the campaign `NAME.yaml` and its file of sizes."""
    folder.mkdir(exist_ok=True)
    (folder / "sieve.csv").write_text(SIEVE)
    path = folder / f"{name}.yaml"
    path.write_text(experiments_text(experiments, **changes))
    return path
