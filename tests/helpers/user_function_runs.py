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


QUANTITIES = """
def of_sample(sample):
    return {"largest": float(sample.radii.max()) * 1e-3, "growth": sample.mean_radius_ratio}

def value(means):
    return (means["growth"] / 3.0 - 1.0) ** 2 + means["largest"]
"""
"""Functions of a module that returns named quantities, and of their means."""


def write_quantities(folder, source=QUANTITIES, trace=None, **numbers):
    """Write `own.yaml` whose objective is made of means, and its module, as `write_own` does."""
    path = write_own(folder, source, trace=trace, **numbers)
    old, text = "call: 'shape:worth'", path.read_text()
    assert text.count(old) == 1
    more = "quantities: {largest: m, growth: 1}, of_means: 'shape:value'"
    path.write_text(text.replace(old, f"call: 'shape:of_sample', {more}"))
    return path
