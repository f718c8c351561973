"""Strings of a campaign that are given by the names of its variables, or as arrays."""

from functools import partial
from typing import TYPE_CHECKING, Any, Final

import numpy as np
from numpy.typing import NDArray

from agglom_mpi.config.quantities import BY_NAME
from agglom_mpi.config.relations import COLUMNS
from agglom_mpi.config.yaml_source import ArgumentError, CampaignError, Problem
from agglom_mpi.declaration.given_values import FRACTIONS, component_of, read_variable
from agglom_mpi.formatting import in_unit
from agglom_mpi.outcome import quantity_columns
from agglom_mpi.variables import VOLUME_FRACTION, VariableTable, size_ratio

if TYPE_CHECKING:
    from agglom_mpi.config.campaign import Campaign

Floats = NDArray[np.float64]

TABLE_COLUMNS: Final = frozenset(
    {*COLUMNS, *BY_NAME, "estimate_standard_error", "estimate_mean_radius_ratio"}
)
"""Columns of the tables of strings that are no variables: results, and what follows from them."""


Parameters = Any
"""Values by name, a mapping or a DataFrame: numbers in SI units or texts with units, one or (n,).

Or strings in SI units, (k,) or (n, k).
"""

ROUNDING: Final = 1e-9
"""Relative difference from a fixed value that is only rounding."""


def read_strings(campaign: "Campaign", parameters: Parameters, share: float = 0.5) -> Floats:
    """Return strings of a campaign, (n, k) in SI units, as `campaign.simulate` reads one.

    Parameters
    ----------
    campaign
    parameters
        Values by name, a mapping or a DataFrame: numbers in SI units or texts with units, each (n,)
        or one for all. Or all variables in SI units, shape (k,) or (n, k).
    share
        Share of the way along its range at which a variable is that is not given.

    Raises
    ------
    CampaignError
        If a name is unknown or a value impossible.
    """
    if not hasattr(parameters, "items"):
        return _whole_strings(campaign, parameters)
    parameters = without_results(campaign, parameters)
    box, problems = campaign.variables, []
    columns: dict[str, tuple[str, Floats]] = {}
    for key, value in parameters.items():
        try:
            name, values = _read_column(str(key), value, box)
            if name in columns:
                other = columns[name][0]
                raise ValueError(f"is given beside {other}; give one of {', '.join(FRACTIONS)}")
            columns[name] = str(key), values
        except ValueError as error:
            problems.append(Problem(campaign.name, None, str(key), str(error)))
    if problems:
        raise CampaignError(*problems)
    try:
        shape = np.broadcast_shapes((1,), *(values.shape for _, values in columns.values()))
    except ValueError:
        lengths = {key: len(values) for key, values in columns.values() if values.shape}
        said = ", ".join(f"{key} {length}" for key, length in lengths.items())
        message = f"have different lengths ({said}); must have one, or be one value for all"
        raise ArgumentError.of(campaign.name, "parameters", message) from None
    strings = np.tile(box.at(share), (*shape, 1))
    for name, (_, values) in columns.items():
        if box[name].is_used:
            strings[:, box.index(name)] = values
    return strings


def without_results(campaign: "Campaign", parameters: Any) -> dict[str, Any]:
    """Return values by name; of rows of a table of strings, such as `file.best()`, the variables.

    What has a `string` is such a row: no variable is called that. Other columns of the tables, and
    what follows from the variables, are left out.
    """
    values = {str(name): value for name, value in parameters.items()}
    if "string" not in values:
        return values
    others = {*TABLE_COLUMNS, *(each.name for each in campaign.relations.derived)}
    others |= {each for name in campaign.sample_quantities for each in quantity_columns(name)}
    others -= set(campaign.variables.further_names)
    if "size_ratio" not in values:  # as in strings of `Searcher.ask`
        others.discard(VOLUME_FRACTION.name)
    return {name: value for name, value in values.items() if name not in others}


def read_searched(campaign: "Campaign", parameters: Parameters) -> Floats:
    """Return strings, (n, k), that give every searched variable and change no other.

    Parameters
    ----------
    campaign
    parameters
        As for `read_strings`.

    Raises
    ------
    CampaignError
        If a name is unknown, a value impossible or missing, or another than the campaign fixed.
    """
    table = campaign.variables
    strings, by_name = read_strings(campaign, parameters), hasattr(parameters, "items")
    names = {str(name) for name, _ in parameters.items()} if by_name else set()
    if VOLUME_FRACTION.name in names:  # it is read as a size ratio
        names.add("size_ratio")
    for variable in table.own:
        if by_name and names.isdisjoint((variable.name, table.names[variable.column])):
            message = "is missing; the campaign searches it"
            raise ArgumentError.of(campaign.name, variable.name, message)
    for name, fixed in table.fixed.items():
        values = strings[:, table.index(name)]
        other = values[np.abs(values - fixed) > ROUNDING * abs(fixed)]
        if len(other):
            own = table.as_named(table[name])
            given, kept = own.of_components(np.array([other[0], fixed])).tolist()
            message = f"is {given:.7g}; the campaign fixed it at {in_unit(f'{kept:.7g}', own.unit)}"
            raise ArgumentError.of(campaign.name, own.name, message)
    return strings


def _whole_strings(campaign: "Campaign", parameters: Any) -> Floats:
    """Return strings of all k numbers; those that the scene uses must be finite."""
    table = campaign.variables
    try:
        values = np.asarray(parameters, np.float64)
    except (TypeError, ValueError):
        values = np.empty(0)
    strings = np.atleast_2d(values)
    if strings.ndim != 2 or strings.shape[1] != table.count:
        found = f"{type(parameters).__name__} of the shape {values.shape}"
        must = f"must be values by name, {table.count} numbers, or (n, {table.count})"
        raise ArgumentError.of(campaign.name, "parameters", f"are {found}; {must}")
    for name in campaign.variables.used:
        values, limits = strings[:, table.index(name)], table[name].limits
        if limits is None:
            wrong = values[~(np.isfinite(values) & (values >= 0.0))].tolist()
            must = "must be a finite number of at least 0"
        else:
            wrong = [one for one in _extremes(values) if limits.broken_by(one)]
            must = f"must be {limits.broken_by(wrong[0])}" if wrong else ""
        if wrong:
            raise ArgumentError.of(campaign.name, name, f"is {wrong[0]:g}; {must}")
    return strings


def _read_column(key: str, value: Any, box: VariableTable) -> tuple[str, Floats]:
    """Return the component that values of a variable give, and its values, (n,) or ()."""
    read = partial(read_variable, table=box)
    if isinstance(value, str) or np.ndim(value) == 0:
        one = value.item() if hasattr(value, "item") else value
        name, number = read(key, one)
        return name, np.asarray(number)
    if np.ndim(value) != 1:
        raise ValueError(f"has the shape {np.shape(value)}; must be one value or one-dimensional")
    name = component_of(key, box)
    values = np.asarray(value)
    if values.dtype.kind not in "iuf":  # of a list, as it is: numpy makes texts of its numbers
        listed = np.asarray(value, object).tolist()
        return name, np.array([read(key, one)[1] for one in listed])
    values = values.astype(np.float64)
    for one in _extremes(values):
        read(key, one)
    if key != name:
        values = np.array([size_ratio(one, box.third_moment) for one in values.tolist()])
    return name, values


def _extremes(values: Floats) -> list[float]:
    """Return those of some numbers, (n,), between which all are allowed if these are."""
    odd = values[~np.isfinite(values)]
    if len(odd) or not len(values):
        return odd[:1].tolist()
    sizes = np.abs(values[values != 0.0])
    return [float(values.min()), float(values.max()), *([float(sizes.min())] if len(sizes) else [])]


def read_string(campaign: "Campaign", parameters: Parameters, share: float = 0.5) -> Floats:
    """Return one parameter string, (k,), in SI units; arguments and errors as of `read_strings`."""
    strings = read_strings(campaign, parameters, share)
    if len(strings) != 1:
        message = f"are {len(strings)} strings; must be one, like a row by .iloc[0]"
        raise ArgumentError.of(campaign.name, "parameters", message)
    return strings[0]
