"""Description of what a campaign would run, as `agglom check CAMPAIGN.yaml` prints it."""

from collections.abc import Collection
from typing import TYPE_CHECKING, Final

import numpy as np

from agglom_mpi.config.consequences import consequences
from agglom_mpi.config.identity import digest, identity
from agglom_mpi.config.scene import SceneSection
from agglom_mpi.config.searchable import allowed_share
from agglom_mpi.declaration.laws import Law
from agglom_mpi.formatting import (
    format_percent,
    in_unit,
    pluralise,
    shortened,
    value_with_prefix,
)
from agglom_mpi.measurements.datum import Datum, exact_values
from agglom_mpi.measurements.layout import CensusLayout
from agglom_mpi.variables import volume_fraction

if TYPE_CHECKING:
    from agglom_mpi.config.campaign import Campaign


def submodels(scene: SceneSection, paths: Collection[str] = ()) -> tuple[list[str], list[str]]:
    """Return a line for each submodel that the scene uses, and the names of all others.

    `paths` are those of the numbers that stand under `variables`.
    """
    laws = list(scene.laws())
    names = [f"{key}: {law.name}" if law.name else key for key, law, is_used in laws]
    width = max(32, *(len(name) + 2 for name in names))
    used = [
        f"{name:<{width}}{law.summary}{_settings(key, law, paths)}"
        for name, (key, law, is_used) in zip(names, laws, strict=True)
        if is_used
    ]
    return used, [key for key, _, is_used in laws if not is_used]


def in_a_few_words(campaign: "Campaign") -> str:
    """Return title, number of grains, and what is searched how, on one line."""
    searched = [variable.name for variable in campaign.variables.own]
    if len(searched) > MAX_NAMED:
        searched = [pluralise(len(searched), "variable")]
    search = "nothing is searched"
    if campaign.plan is not None and searched:
        search = f"searches {', '.join(searched)} by {campaign.search.name}"
    grains = pluralise(campaign.volume * campaign.scene.particles, "grain")
    return f"{shortened(campaign.title)}; {grains}, {search}"


def missing_fields(scene: SceneSection) -> list[str]:
    """Return what is not stored of each particle; `simulation.particles` decides the same."""
    kept = {
        "temperature": not scene.heating.is_absent,
        "time of last cooling": not (scene.cooling.is_absent or scene.cooling.by_steps),
        "time of last impact": scene.restitution.keeps_last_impact,
        "number of grains": not scene.fragmentation.is_absent or scene.sizes is not None,
    }
    return [name for name, used in kept.items() if not used]


def _settings(key: str, law: Law, paths: Collection[str]) -> str:
    pairs = []
    for each in law.settings():
        if any(f"{path}.".startswith(f"{key}.{each.name}.") for path in paths):
            pairs.append(f"{each.name} as in variables")
            continue
        by_default = "" if each.is_given else " (default)"
        pairs.append(f"{each.name} {in_unit(_plain(each.value), each.unit)}{by_default}")
    return f"; {', '.join(pairs)}" if pairs else ""


def _plain(value: object) -> str:
    if isinstance(value, tuple):
        return f"({', '.join(map(_plain, value))})"
    return f"{value:g}" if isinstance(value, float) else str(value)


MAX_NAMED: Final = 4
"""Maximum number of searched variables that are named on one line."""

Paragraph = tuple[str, list[str]]
"""A heading with its lines."""

FINAL_BYTES: Final = 32
"""Bytes stored of a grain at the end of a sample."""
MAX_DRAWN, DRAWN_WIDTH = 24, 50
"""Maximum number of impacts that are drawn, and the width of a coefficient of 1 in characters."""
FRAME_BYTES: Final = 88
"""Bytes stored of a grain in a frame."""


def text(campaign: "Campaign") -> str:
    """Return all paragraphs, each a heading with indented lines."""
    return "\n".join(
        line
        for heading, lines in sections(campaign)
        for line in (heading, *(f"  {line}" for line in lines))
    )


def as_dict(campaign: "Campaign") -> dict[str, object]:
    """Return the paragraphs as plain values for JSON, and what decides results."""
    (_, run), *others = sections(campaign)
    found: dict[str, object] = {"file": campaign.name, "title": campaign.title, "run": run}
    found |= {heading.lower().replace(" ", "_"): lines for heading, lines in others}
    entries = identity(campaign)
    return found | {"sha256": digest(entries), "identity": entries}


def sections(campaign: "Campaign") -> list[Paragraph]:
    """Return headings with their lines."""
    paths = campaign.variables.further_names
    used, left_out = submodels(campaign.scene, paths)
    return [
        (shortened(campaign.title) or campaign.name, _run(campaign)),
        ("Scene", _scene(campaign)),
        ("Variables", _variables(campaign)),
        *_relations(campaign),
        *_data(campaign),
        ("What follows", consequences(campaign)),
        ("Submodels", used),
        ("Left out", left_out + _not_stored(campaign) or ["nothing"]),
    ]


def _relations(campaign: "Campaign") -> list[Paragraph]:
    """Return the constraints, with the share of the box that they allow."""
    constraints = campaign.relations.constraints
    if not constraints:
        return []
    lines = [each.text for each in constraints]
    if campaign.variables.searched:
        lines += [f"allowed: {allowed_share(campaign)} of the box, by random strings"]
    return [("Constraints", lines)]


def _data(campaign: "Campaign") -> list[Paragraph]:
    """Return a line for each measured datum, and a drawing of impacts."""
    if campaign.experiments:
        return _experiments(campaign)
    if not isinstance(campaign.census, CensusLayout):
        return []
    lines = []
    for entry, datum in zip(campaign.data_entries, campaign.data, strict=True):
        lines += [entry.summary, *_drawn_impacts(campaign, datum)]
    if exact_values(campaign.data).all():
        lines.append("the laws predict all data without samples: one sample of a string suffices")
    times, size = len(campaign.census.times), value_with_prefix(campaign.census.bytes, "B")
    classes = f"{campaign.census.classes} classes of size, 2 % wide"
    counted = f"every sample is counted in {classes}, at {pluralise(times, 'time')}: {size} a row"
    return [("Data", [*lines, counted])]


def _experiments(campaign: "Campaign") -> list[Paragraph]:
    found = []
    shared, common = campaign.variables, _scene(campaign.experiments[0].campaign)
    for each in campaign.experiments:
        own = each.campaign
        names = [
            variable.name
            for variable, place in zip(own.variables.variables, each.places.tolist(), strict=True)
            if variable.is_used and (place < 0 or shared.names[place] != variable.name)
        ]
        lines = _variables(own, names) + [line for line in _scene(own) if line not in common]
        if own.data:
            [(_, data)] = _data(own)
            lines += data
        else:
            lines.append("no data: a candidate for the next experiment")
        found.append((f"Experiment {each.name}", lines))
    return found


def _drawn_impacts(campaign: "Campaign", datum: Datum) -> list[str]:
    """Draw measured coefficients and the law in the middle of the box, by ascending speed."""
    if datum.impacts is None:
        return []
    try:
        tests = campaign.impact_tests_at(campaign.parameters())
    except ValueError as problem:
        return [f"  no law in the middle of the box: {problem}"]
    numbers = datum.impacts[:, 0], datum.values, datum.standard_errors
    found = sorted(np.column_stack((*numbers, tests.coefficients(datum.impacts))).tolist())
    step = -(-len(found) // MAX_DRAWN)
    lines = [f"{'speed, m/s':>10}  0{'1':>{DRAWN_WIDTH}}   o measured, + law at the middle, * both"]
    for speed, value, error, law in found[::step]:
        ends = value - error, value + error, value, law
        low, high, own, other = (round(DRAWN_WIDTH * min(max(end, 0.0), 1.0)) for end in ends)
        row = ["-" if low <= place <= high else " " for place in range(DRAWN_WIDTH + 1)]
        row[own], row[other] = "o", "*" if own == other else "+"
        lines.append(f"{speed:>10.3g} |{''.join(row)}|  {value:.3f} {law:.3f}")
    return lines


def _not_stored(campaign: "Campaign") -> list[str]:
    lines = []
    if fields := missing_fields(campaign.scene):
        lines.append(f"particles do not record: {', '.join(fields)}")
    if campaign.plan is not None:
        output = campaign.output
        absent = [] if output.final_particles else ["single particles"]
        absent += [] if output.frames else ["states before the end"]
        if absent:
            lines.append(f"samples do not store: {', '.join(absent)}")
    return lines


def _run(campaign: "Campaign") -> list[str]:
    lines = [f"seed: {campaign.seed}", f"objective: {_objective(campaign)}"]
    if campaign.plan is None:
        return [*lines, "a scene: nothing is searched, `agglom simulate` runs it"]
    return lines + _search(campaign) + _stored(campaign)


def _stored(campaign: "Campaign") -> list[str]:
    output, grains = campaign.output, campaign.scene.particles
    lines = []
    if output.final_particles:
        size = FINAL_BYTES * grains
        lines.append(f"stored of every sample: its final particles, {size / 1e3:.3g} kB")
    if output.frames is not None:
        count, (strings, samples) = output.frames.count, campaign.max_framed
        size = FRAME_BYTES * grains * count * strings * samples
        best = "the best string" if strings == 1 else f"each of the best {strings} strings"
        lines.append(
            f"stored of {pluralise(samples, 'sample')} of {best}: {pluralise(count, 'frame')}, "
            f"{size / 1e6:.3g} MB in all"
        )
    return lines


def _search(campaign: "Campaign") -> list[str]:
    search, ensemble, stopping = campaign.search, campaign.ensemble, campaign.stopping
    strings = campaign.max_strings
    sooner = bool(stopping.criteria)
    fewest = search.first_generation if sooner else strings
    lines = [*search.describe(), f"ensemble: {ensemble.summary}"]
    if ensemble.common_configurations:
        lines.append("configurations: sample k of all strings starts from the same random numbers")
    if ensemble.racing is not None:
        first = pluralise(ensemble.racing.first, "sample")
        lines.append(
            f"racing: from {first} on, strings that are not among the best "
            f"{search.kept} get no more, at a confidence of {ensemble.racing.confidence:g}"
        )
    lines += [f"target: {criterion.summary}" for criterion in stopping.criteria.values()]
    least = ensemble.min_samples if ensemble.is_adaptive else ensemble.max_samples
    lines += [
        f"generations: {_between(1 if sooner else None, stopping.generations)}",
        f"strings: {_between(fewest, strings)}",
        f"samples: {_between(fewest * least, strings * ensemble.max_samples)}, "
        f"{_between(least, ensemble.max_samples)} per string",
        f"final answer: {_final(campaign)}",
    ]
    if campaign.required_plan.certify is not None:
        lines.append(f"certificate of the set: {campaign.required_plan.certify.text}")
    if ensemble.is_published:
        lines.append("samples per string in the papers: 125 [A] (tolerance 1e-5), 11.84 [B] (5e-4)")
    return lines


def _final(campaign: "Campaign") -> str:
    final = campaign.final
    if final is None:
        return "none; objectives are as searched, by the samples that strings are chosen by"
    strings = min(final.strings, campaign.max_strings)
    best = "the best string" if strings == 1 else f"the best {strings} strings"
    text = f"{best} estimated again, each on {pluralise(final.samples, 'fresh sample')}"
    if not final.larger:
        return text
    grains = [f"{volume * campaign.scene.particles:,}" for volume in final.larger]
    return f"{text}, and on as many with {', '.join(grains)} grains in as much larger boxes"


def _between(fewest: int | None, most: int) -> str:
    return f"{most:,}" if fewest in (None, most) else f"{fewest:,} to {most:,}"


def _objective(campaign: "Campaign") -> str:
    function = campaign.user_function
    if function is None:
        return campaign.objective.summary
    digest = f"SHA-256 {function.module.sha256[:16]}"
    return f"{campaign.objective.summary} ({digest}), run with --allow-code only"


def _scene(campaign: "Campaign") -> list[str]:
    scene = campaign.scene
    mean = "" if scene.sizes is None else "mean "
    box = campaign.variables
    paths, ends = box.further_names, [campaign.at(end) for end in (box.lower, box.upper)]
    if scene.diameter is not None:
        diameter = value_with_prefix(scene.diameter, "m")
        if campaign.scenes.lengths_differ and len({s.diameter for s, _ in ends}) > 1:
            diameter = "as in variables"
        size = f"grains: {mean}diameter {diameter}; the box follows from it"
    else:
        filled = [volume_fraction(v["size_ratio"], s.third_moment) for s, v in ends]
        fraction = " to ".join(dict.fromkeys(f"{each:.3g}" for each in sorted(filled)))
        width = "as in variables" if "half_width" in paths else f"{scene.half_width:g} m"
        size = f"box: half-width {width}, volume fraction {fraction}"
    if "end_time" in paths:
        end = "as in variables"
    elif scene.end_time == "characteristic":
        end = "characteristic time, (S/v_crit) ln(0.01)/ln(0.9) [A 13]"
    else:
        end = f"{scene.end_time:g} s"
    return [
        f"particles: {scene.particles:,}",
        *_sizes(campaign),
        size,
        f"engine: {scene.engine.summary}",
        f"end time: {end}",
    ]


SHARES: Final = (0.1, 0.5, 0.9)
"""Shares of the grains, or of their volume, that are smaller than d10, d50 and d90."""


def _sizes(campaign: "Campaign") -> list[str]:
    """Return the law of sizes with its quantiles by number and by volume, if grains differ.

    Where strings have numbers of the law these are of the middle of the box.
    """
    scene = campaign.scene
    law, diameter = scene.size_law, scene.diameter
    if scene.sizes is None or law is None:
        return []
    middle = " in the middle of the box" if campaign.scenes.sizes_differ else ""

    def text(ratio: float) -> str:
        return f"{ratio:.3g}" if diameter is None else value_with_prefix(ratio * diameter, "m")

    unit = ", over the mean diameter" if diameter is None else ""
    lines = [f"sizes{middle}: {scene.sizes.summary}"]
    for name, by_volume in (("number", False), ("volume", True)):
        found = [f"d{100 * share:.0f} {text(law.quantile(share, by_volume))}" for share in SHARES]
        found += [f"D[4,3] {text(law.volume_mean)}"] if by_volume else []
        lines.append(f"diameters by {name}: {', '.join(found)}{unit}")
    if errors := scene.sizes.errors_of_means():
        number, volume = map(format_percent, errors)
        lines.append(f"errors of the curve: mean diameter ± {number}, D[4,3] ± {volume}")
    return lines


def _variables(campaign: "Campaign", names: Collection[str] | None = None) -> list[str]:
    """Return a line for each variable, or for some of them by their names."""
    box, lines = campaign.variables, []
    width = max([18, *(len(name) + 1 for name in box.further_names)])
    for variable in box.variables:
        if names is not None and variable.name not in names:
            continue
        if variable.is_used:
            own = box.as_named(variable)
            value = (
                f"{own.lower:g} .. {own.upper:g}" if own.is_searched else f"{own.lower:g} (fixed)"
            )
            value += ", logarithmic" if own.is_searched and own.logarithmic else ""
        elif variable.name in box.ignored:
            own, value = variable, "ignored: nothing depends on it"
        else:
            continue
        unit = "" if own.unit == "1" else own.unit
        lines.append(f"{own.name:<{width}}{unit:<8}{value}")
    return lines
