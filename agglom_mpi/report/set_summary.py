"""The feasible set of a campaign as text and as plain values for JSON."""

from collections.abc import Iterator
from typing import TYPE_CHECKING, Any, Final

from rich.console import Group, RenderableType

from agglom_mpi.config.searchable import allowed_share
from agglom_mpi.display.table import Column, Facts, Table
from agglom_mpi.errors import error_text
from agglom_mpi.formatting import format_percent, value_with_error, without_nan
from agglom_mpi.inference.certificate import Certificate
from agglom_mpi.inference.certified_part import CertificateError
from agglom_mpi.inference.emulated_set import BOX_POINTS
from agglom_mpi.inference.feasible_set import FeasibleSet
from agglom_mpi.inference.set_directions import SetVariable, name_ends, rounded
from agglom_mpi.inference.set_points import INNER_PROBABILITY, OUTER_PROBABILITY
from agglom_mpi.report.posterior_summary import measure_text, posterior_text, variable_rows
from agglom_mpi.storage.access import NotACampaign
from agglom_mpi.variables import Variable

if TYPE_CHECKING:
    import pandas as pd

    from agglom_mpi.inference.posterior import Posterior

MIN_SHOWN_SHARE: Final = 0.01
"""Minimum share of a direction that is shown."""
MIN_SHOWN_PROBABILITY: Final = 1e-6
"""Smallest probability that is shown as a number."""
MIN_NAMED_WEIGHT: Final = 0.1
"""Minimum weight of a variable that is named in a direction, relative to the largest weight."""

BIASED_CHOICE: Final = (
    "were chosen by a search for the best string, which returns to lucky strings; P can be biased "
    "near the edges of the set"
)
"""Note on samples that a search for the best has chosen."""


def samples_to_halve(of: FeasibleSet) -> int:
    """Return the number of further samples that halve the expected error, which is ~ N^(-1/2)."""
    return 3 * of.samples


def set_text(of: FeasibleSet, posterior: "Posterior | None" = None) -> RenderableType:
    """Return what `agglom report --feasible-set` prints."""
    heading = f"feasible set: {of.criterion.text}"
    if not of.calibration.passed:
        return f"{of.calibration.text}; no set is given\n{heading}, {_rests_on(of)}"
    parts: list[RenderableType] = [f"{heading}\n{_rests_on(of)}", _shares(of)]
    if of.empty:
        parts.append(_nearest_table(of))
    elif of.volume > 0.0:
        parts.append(_variable_table(of))
        parts += [_direction_table(of)] if len(of.directions) else []
    parts += list(set_warnings(of))
    if posterior is not None:
        parts += ["", posterior_text(posterior)]
    return Group(*parts)


def _rests_on(of: FeasibleSet) -> str:
    learned = f", {of.learned:,} of them learned from {of.learned_from}" if of.learned else ""
    return f"from an emulator of {of.samples:,} samples of {of.strings:,} strings{learned}"


def _shares(of: FeasibleSet) -> Facts:
    box, rows = of.emulated.box, list[tuple[str, str]]()
    if of.empty:
        probability = of.nearest.probability
        shown = f"P < {MIN_SHOWN_PROBABILITY:g}"
        if probability >= MIN_SHOWN_PROBABILITY:
            shown = f"P = {probability:.2g}"
        rows += [("the set", empty_text(of)), ("nearest", f"{of.nearest.reached}, {shown}")]
    else:
        share = value_with_error(100.0 * of.volume, 100.0 * of.volume_error)
        rows.append(("share of the box", f"{share} %; {measure_text(box)}"))
    if of.allowed < 1.0:
        shares = "" if of.empty else "; shares refer to the allowed part"
        rows.append(("constraints", f"allow {allowed_share(box.campaign)} of the box{shares}"))
    if not of.empty:
        rows.append((f"  surely (P ≥ {INNER_PROBABILITY:g})", format_percent(of.inner, 3)))
        rows.append((f"  possibly (P ≥ {OUTER_PROBABILITY:g})", format_percent(of.outer, 3)))
    if of.volume > 0.0 and not of.empty and not of.robust:
        # The search that would take these samples is named where it is not that of the campaign.
        is_other = box.campaign.objective.is_magnitude and not box.campaign.search.looks_for_a_set
        search = " of a search with aim: set" if is_other else ""
        error = (
            f"{format_percent(of.expected_error, 3)} of the set's volume is wrongly in or out of "
            f"P ≥ 0.5; {samples_to_halve(of):,} more samples{search} would halve it (raise "
            "stopping.generations and start the same command again)"
        )
        rows.append(("expected error", error))
    if of.criterion.maximum is not None:
        rows.append(("maximum", f"mean b/b0 {value_with_error(*of.criterion.maximum)}"))
    if of.failing:
        rows.append(("failed", f"{of.failing} strings, which are not members"))
    certificate, refused = certificate_or_reason(of)
    if certificate is not None:
        rows.append(("certificate", "\n".join(certificate.lines())))
    elif refused:
        rows.append(("certificate", refused))
    rows.append(("check", of.calibration.text))
    if of.favours_low_objectives:
        rows.append(("samples", BIASED_CHOICE))
    return Facts(rows)


def certificate_or_reason(of: FeasibleSet) -> tuple[Certificate | None, str]:
    """Return the certificate of a set, or None and why a file beside the campaign's is none."""
    try:
        return of.certificate, ""
    except (CertificateError, NotACampaign, OSError) as error:
        return None, error_text(error)


def empty_text(of: FeasibleSet) -> str:
    """Return the reason for which a set has no members, or none that the emulator can find."""
    if of.nearest.out_of_reach:
        return f"empty: no string of the box is a member with P ≥ {OUTER_PROBABILITY:g}"
    return (
        f"empty as far as is known: no string of the box is a member with P ≥ "
        f"{OUTER_PROBABILITY:g}, for the emulator is less sure of its means than the tolerance is "
        "wide"
    )


def _nearest_table(of: FeasibleSet) -> Table:

    def cells(variable: Variable, factor: float) -> dict[str, Any]:
        end = of.nearest.ends.get(variable.name)
        at = of.nearest.parameters[variable.name] / factor
        return {"nearest at": at, "end": f"{end} end" if end else ""}

    box = of.emulated.box
    rows = variable_rows(box.campaign.text, box.own, cells)
    columns = Column("variable"), Column("searched"), Column("nearest at", format=".4g")
    return Table((*columns, Column("end", "", text=True)), rows)


SET_COLUMNS: Final = (
    Column("variable"),
    Column("searched"),
    Column("possible"),
    Column("low", "5 %", format=".3g"),
    Column("median", "50 %", format=".3g"),
    Column("high", "95 %", format=".3g"),
    Column("kept", "can vary by", format=lambda share: f"{100.0 * share:.0f} %"),
    Column("free", "", format=lambda free: "free" if free else "decided", text=True),
)


def _variable_table(of: FeasibleSet) -> Table:
    def cells(variable: SetVariable, factor: float) -> dict[str, Any]:
        possible = f"{variable.least / factor:.3g} to {variable.most / factor:.3g}"
        row = {name: getattr(variable, name) / factor for name in ("low", "median", "high")}
        return row | {"possible": possible, "kept": variable.kept, "free": variable.free}

    rows = variable_rows(of.emulated.box.campaign.text, of.variables, cells)
    return Table(SET_COLUMNS, rows)


DIRECTION_COLUMNS: Final = (
    Column("product", "what decides"),
    Column("share", format=lambda share: f"{100.0 * share:.1f} %"),
    Column("near", "", text=True),
)


def _direction_table(of: FeasibleSet) -> Table:
    rows = shown_directions(of)
    for row in rows:
        row["near"] = row["group"] and f"near {row['group']} (cosine {row['cosine']:.3f})"
    return Table(DIRECTION_COLUMNS, rows)


def shown_directions(of: FeasibleSet) -> list[dict[str, Any]]:
    """Return the directions that matter as plain values, with their products of powers."""
    found: list[dict[str, Any]] = []
    for row in of.directions.to_dict("records"):
        if row["share"] < MIN_SHOWN_SHARE and found:
            break
        found.append(
            {
                "eigenvalue": row["eigenvalue"],
                "share": row["share"],
                "exponents": {name: row[name] for name in of.emulated.box.names},
                "product": product_text(of, row),
                "group": row["group"] or None,
                "cosine": row["cosine"] if row["group"] else None,
            }
        )
    return found


def product_text(of: FeasibleSet, row: Any) -> str:
    """Return a direction as a product of powers, rounded, of the variables that matter in it."""
    spans = zip(of.emulated.box.names, of.emulated.spans, strict=True)
    weights = {name: abs(row[name]) * span for name, span in spans}
    least = MIN_NAMED_WEIGHT * max(weights.values())
    order = sorted(weights, key=lambda name: -weights[name])
    factors = [_factor(n, rounded(row[n])) for n in order if weights[n] > least]
    return " ".join(factor for factor in factors if factor)


def _factor(name: str, exponent: float) -> str:
    if exponent == 0.0:
        return ""
    return name if exponent == 1.0 else f"{name}^{exponent:.3g}"


def set_warnings(of: FeasibleSet) -> Iterator[str]:
    """Yield warnings about a set: where it touches the box, and if it is empty or hard to see."""
    if of.empty:
        if of.nearest.ends:
            ends = ", ".join(f"the {end} end of {name}" for name, end in of.nearest.ends.items())
            yield f"warning: the nearest string is at {ends}; members may lie outside of the box"
        return
    if of.volume <= 0.0 or of.outer == 0.0:
        yield (
            "warning: the set is smaller than the points that measure it can resolve; it is near "
            f"{of.nearest}"
        )
        return
    for each in of.variables:
        if each.touches and not each.free:
            ends = name_ends(each, each.touches)
            yield f"warning: the set touches {ends} and may continue outside of the box"


def set_as_dict(of: FeasibleSet, posterior: "Posterior | None" = None) -> dict[str, Any]:
    """Return a set as plain values for JSON; without a set where it is not calibrated.

    Keys at the top are `criterion`, `tolerance`, the deviations `robust`, the numbers of `samples`
    and `strings` of the emulator and of `learned_samples` among them, its `calibration`, the `set`,
    or None and the `reason`, and the `posterior` if a measured mean is given (`Posterior.as_dict`).
    Those of the set:

    - `measure`: in what volumes are uniform; `allowed`: share of the box by the constraints.
    - `volume`, `volume_error`, `inner`, `outer`: shares of what is allowed; inner and outer are
      those with a probability of at least 0.95 and 0.05.
    - `expected_error`: relative to the volume; `samples_to_halve` it.
    - `variables`: the attributes of a `SetVariable` each, in the SI unit `unit`.
    - `directions`: `product` of powers with `exponents` by name, their `share`, `eigenvalue`, and
      the dimensionless `group` that is near with its `cosine`.
    - `empty`, `nearest`: whether there are members, and what comes nearest if there are none.
    - `certificate`: what fresh runs prove of the set (`Certificate.as_dict`), or None.
    - `failed_strings`, `favours_low_objectives`, `warnings`; of `maximum_growth` its `maximum` and
      `maximum_error`.
    """
    found: dict[str, Any] = {
        "criterion": of.criterion.text,
        "tolerance": of.tolerance,
        "robust": of.robust,
        "samples": of.samples,
        "strings": of.strings,
        "learned_samples": of.learned,
        "calibration": of.calibration.as_dict(),
    }
    if not of.calibration.passed:
        return found | {"set": None, "reason": of.calibration.text}
    certificate, refused = certificate_or_reason(of)
    unknown = of.volume <= 0.0 or of.robust
    warnings = [text.removeprefix("warning: ") for text in set_warnings(of)]
    found["set"] = {
        "measure": measure_text(of.emulated.box),
        "empty": of.empty,
        "volume": of.volume,
        "volume_error": of.volume_error,
        "allowed": of.allowed,
        "inner": of.inner,
        "outer": of.outer,
        "expected_error": None if of.empty else without_nan(of.expected_error),
        "samples_to_halve": None if of.empty or unknown else samples_to_halve(of),
        "certificate": certificate.as_dict() if certificate is not None else None,
        "failed_strings": of.failing,
        "favours_low_objectives": of.favours_low_objectives,
        "variables": [each._asdict() for each in of.variables],
        "directions": shown_directions(of),
        "nearest": of.nearest.as_dict() if of.empty else None,
        "warnings": warnings + ([refused] if refused else []),
    }
    if of.criterion.maximum is not None:
        found["set"]["maximum"], found["set"]["maximum_error"] = of.criterion.maximum
    if posterior is not None:
        found["posterior"] = posterior.as_dict()
    return found


def grid_table(of: FeasibleSet, most: int = 20_000) -> "pd.DataFrame":
    """Tabulate probability, mean and deviation on a grid of the box.

    Of up to four variables it has as many places of each as make at most `most` points; of more
    variables a grid is too coarse, and its points are the even ones that the set is measured by.
    """
    import numpy as np

    emulated, d = of.emulated, len(of.emulated.box.names)
    if d <= 4:
        places = (np.arange(side := int(most ** (1.0 / d) + 1e-9)) + 0.5) / side
        mesh = np.stack(np.meshgrid(*[places] * d, indexing="ij"), axis=-1).reshape(-1, d)
        strings = emulated.box.space.from_unit(mesh)
    else:
        strings = emulated.box.even_strings(BOX_POINTS)
    mean, deviation = emulated.mean(strings), emulated.deviation(strings)
    columns = {"probability": emulated.probability(strings)}
    for i, name in enumerate(of.criterion.quantities):
        columns |= {f"mean_of_{name}": mean[:, i], f"deviation_of_{name}": deviation[:, i]}
    return emulated.box.table(strings, **columns)
