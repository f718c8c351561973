"""A small valid campaign, and copies of it with single lines changed."""

from agglom_mpi.config.campaign import Campaign

TEXT = """\
title: A test
seed: 7
scene:
  particles: 100
  half_width: 0.01
  velocities: uniform_x
  restitution: pressure
  contact_area: {initial: 0.01, final: 1}
  hardness: arrhenius
  friction: constant
  heating: pair_split
  reaction: contact_area
  cooling: none
  end_time: characteristic
  engine: {law: fixed, steps: 50}
variables:
  relative_speed: [0.1, 30]
  size_ratio: [0.4, 0.8]
  density: 6000
  hardness: [1e7, 2e8]
  heat_capacity: 1000
  friction: 0.3
  temperature: 300
  activation_energy: 500
  reaction_heat: 1e6
objective: {law: growth_target, ratio: 2}
search: {population: 12, parents: 4}
ensemble:
  rule: successive_difference
  tolerance: 1e-3
  max_samples: 20
stopping:
  generations: 5
  target: none
"""


def edited(*edits: tuple[str, str]) -> str:
    """Text with the lines that begin with the first of each pair replaced by the second.

    An empty replacement takes the line out.
    """
    lines = TEXT.splitlines()
    for begin, replacement in edits:
        [i] = [i for i, line in enumerate(lines) if line.startswith(begin)]
        lines[i] = replacement
    return "\n".join(lines) + "\n"


def campaign(*edits: tuple[str, str]) -> Campaign:
    """The campaign of an edited text."""
    return Campaign.from_text(edited(*edits))


def constant(
    contact_time: str | None = None, value: float = 0.9, end_time: str = "1 ms"
) -> Campaign:
    """The campaign with constant restitution, of which no hardness decides anything."""
    lasting = "" if contact_time is None else f", contact_time: {contact_time}"
    return campaign(
        ("  restitution", f"  restitution: {{law: constant, value: {value}{lasting}}}"),
        ("  hardness: a", ""),
        ("  hardness: [", ""),
        ("  end_time", f"  end_time: {end_time}"),
    )
