"""Section `correlations`: of the errors of measured numbers, such as those of one calibration."""

from collections.abc import Mapping, Sequence
from itertools import combinations
from typing import Annotated, Any, Final

import numpy as np

from agglom_mpi.config.data_section import DatumEntry, repeated_data
from agglom_mpi.declaration.components import In
from agglom_mpi.declaration.declared import Declared, FieldPath, Meaning, raise_field_errors
from agglom_mpi.declaration.reading import Reading
from agglom_mpi.declaration.units import quoted

MIN_EIGENVALUE: Final = 1e-10
"""Minimum eigenvalue of the matrix of all correlations."""

Pairs = Mapping[tuple[int, int], float]
"""Stated correlations by the places of two data, the earlier one first."""


class Correlation(Declared):
    """Correlation between the errors of measured numbers.

    Attributes
    ----------
    between
        Two data or more; each pair of them has it. A datum is named by its quantity such as `d50`,
        as `agglom check` prints it, such as `d50 by mass at 2 ms`, or by its place in `data`, from
        0.
    value
        Correlation of the errors; 0 states that two measurements are independent.
    """

    between: Annotated[tuple[Any, ...], Meaning("a list of two data or more, like [d50, d90]")]
    value: Annotated[float, In("1", above=-1, below=1, meaning="the correlation of the errors")]


def stated_pairs(
    data: Sequence[DatumEntry], correlations: Sequence[Correlation]
) -> tuple[Pairs, list[tuple[FieldPath, str]]]:
    """Return the correlation of each stated pair of data, and what is wrong with the section."""
    found: dict[tuple[int, int], float] = {}
    problems: list[tuple[FieldPath, str]] = []
    for i, each in enumerate(correlations):
        places = []
        for k, given in enumerate(each.between):
            try:
                places.append(_place(given, data, each.value))
            except ValueError as error:
                problems.append(((i, "between", k), str(error)))
        if len(each.between) < 2:
            problems.append(((i, "between"), "has fewer than two data; must have two or more"))
        for one, other in combinations(sorted(places), 2):
            if one == other or (one, other) in found:
                message = f"has data.{one} and data.{other}; must have different data, each pair"
                problems.append(((i, "between"), f"{message} once in the section"))
            found[one, other] = each.value
    if not problems:
        matrix = np.eye(len(data))
        for pair, value in found.items():
            matrix[pair] = matrix[pair[::-1]] = value
        least = np.linalg.eigvalsh(matrix).min(initial=1.0)
        if least < MIN_EIGENVALUE:
            message = f"contradict each other: the least eigenvalue of their matrix is {least:.2g}"
            problems.append(((), f"{message}; must be greater than 0"))
    return found, problems


def correlated(
    data: tuple[DatumEntry, ...],
    correlations: Sequence[Correlation],
    end: float | str,
    reading: Reading,
) -> tuple[DatumEntry, ...]:
    """Return data with their correlations; `end` is the `end_time` of the scene.

    Raises
    ------
    FieldError
        If the section is wrong, or data stand twice.
    """
    pairs, wrong = stated_pairs(data, correlations)
    raise_field_errors((("correlations", *path), message) for path, message in wrong)
    if not reading.recorded:
        repeated = repeated_data(data, end, pairs)
        raise_field_errors((("data", *path), message) for path, message in repeated)
    of = [{i: r for (i, j), r in pairs.items() if j == k} for k in range(len(data))]
    return tuple(map(DatumEntry.with_correlations, data, of))


def _place(given: Any, data: Sequence[DatumEntry], value: float) -> int:
    """Return the place of the one datum that is named; raise a ValueError otherwise."""
    if isinstance(given, int) and not isinstance(given, bool):
        places = [given] if 0 <= given < len(data) else []
    else:
        places = [i for i, entry in enumerate(data) if given in (entry.label, entry.quantity)]
    if len(places) != 1:
        which = "several data; name it by its place" if places else "no datum"
        known = ", ".join(f"{i} ({entry.label})" for i, entry in enumerate(data))
        raise ValueError(f"is {quoted(given)}, which is {which}; allowed: {known or 'nothing'}")
    kind = data[places[0]].kind
    if value and kind.has_file:
        what, errors = ("impacts", "") if kind.is_exact else ("a curve", " of its shares")
        message = f"{what}; must be data of one number, as its file has the errors{errors}"
        raise ValueError(f"is {quoted(given)}, {message}")
    return places[0]
