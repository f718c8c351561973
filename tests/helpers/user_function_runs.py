"""Small campaigns whose objective is a function of a module beside them."""

from campaign_runs import write_campaign

NUMBERS = {"generations": 2, "max_samples": 8, "population": 4, "parents": 2}

WORTH = """
def worth(sample):
    largest = sample.radii.max()
    assert sample.particles == len(sample.radii) == len(sample.grains)
    return float(largest / sample.mean_radius_ratio - sample.parameters["size_ratio"])
"""
"""Of either sign, and from single particles, which are stored nowhere."""


def write_own(folder, source=WORTH, name="own", trace=None, **numbers):
    """Write `name`.yaml and its module; that appends to the file `trace` when it is executed."""
    path = write_campaign(folder / f"{name}.yaml", **(NUMBERS | numbers))
    text = path.read_text()
    old = "objective: {law: growth_target, ratio: 2}"
    assert text.count(old) == 1
    path.write_text(text.replace(old, "objective: {law: function, call: 'shape:worth'}"))
    if trace is not None:
        source = f"with open({str(trace)!r}, 'a') as file: file.write('x')\n{source}"
    (folder / "shape.py").write_text(source)
    return path
