"""A liquid on grains in two experiments with data, and in one that was not made."""

ERROR = 0.02
VALUES = f"[{{{{quantity: particles_left, value: {{!r}}, error: {ERROR}}}}}]"
TEXT = """\
title: Which liquid is on these grains?
seed: {seed}
scene:
  particles: 80
  grain_diameter: 100 um
  velocities: {{law: spread, mean: [0, 0, 0], transverse: 1}}
  restitution: {{law: wet, roughness: 0.1 um, dry: {{law: constant, value: 0.9}}}}
  heating: none
  end_time: 5 ms
variables:
  relative_speed: 0.3 m/s
  volume_fraction: 0.08
  density: 2.5 g/cm3
  restitution.viscosity: [1 mPa*s, 20 mPa*s, log]
  restitution.film_thickness: [0.7 um, 5 um, log]
experiments:
{experiments}
objective: {{law: misfit}}
search: {search}
ensemble: {{rule: fixed, samples: 10}}
stopping: {{generations: {generations}}}
final: {{strings: 2, samples: 10}}
"""
ROUGH = "restitution: {law: wet, roughness: 0.6 um, dry: {law: constant, value: 0.9}}"
EVEN = "{method: sobol, population: 32}", 6
SEARCHED = "{method: surrogate, initial: 48, batch: 16}", 6
"""Searches, with their generations: of strings that no result has proposed, and near the data."""


def experiments(polished, second, is_rough):
    """Return polished grains and second ones, by their data: rough grains, or fast ones.

    Polished grains alone leave the film undecided. Fast ones decide little of it, and rough ones
    follow as an experiment without data.
    """
    first, other = VALUES.format(polished), VALUES.format(second)
    lines = [f"  polished: {{data: {first}}}"]
    if is_rough:
        lines.append(f"  rough: {{scene: {{{ROUGH}}}, data: {other}}}")
    else:
        lines.append(f"  fast: {{variables: {{relative_speed: 1 m/s}}, data: {other}}}")
        lines.append(f"  rough: {{scene: {{{ROUGH}}}}}")
    return "\n".join(lines)


def write_two(folder, values=(0.2, 0.5), is_rough=True, search=EVEN, seed=1):
    """Write a campaign of experiments with these values, and return its path."""
    folder.mkdir(exist_ok=True, parents=True)
    method, generations = search
    own = experiments(*map(float, values), is_rough)
    text = TEXT.format(seed=seed, experiments=own, search=method, generations=generations)
    path = folder / "two.yaml"
    path.write_text(text)
    return path


def drawn_truths(box, count, random):
    """Return strings drawn evenly from a search box, shape (count, k)."""
    return box.space.from_unit(random.random((count, len(box.names))))
