"""What a macroscopic model gives: numbers, arrays or distributions, checked one by one."""

from typing import Any, Final

import numpy as np
import numpy.typing as npt

Floats = npt.NDArray[np.float64]

VECTORS: Final = ("positions", "velocities")
"""Arguments with three components per particle."""
UNITS: Final = {"radii": "m", "positions": "m", "velocities": "m/s", "temperatures": "K"}


def is_law(given: Any) -> bool:
    """Whether something given is to be drawn from: a frozen distribution or a function."""
    return hasattr(given, "rvs") or callable(given)


def number_of(asked: int | None, default: int, **given: Any) -> int:
    """Return how many particles the arrays that are `given` by name are for.

    Parameters
    ----------
    asked
        The argument `particles`; arrays must agree with it.
    default
        If nothing says how many.
    """
    said: dict[str, int] = {}
    if asked is not None:
        if isinstance(asked, bool) or not isinstance(asked, int | np.integer) or asked < 1:
            raise ValueError(f"particles are {asked!r}; must be a whole number of at least 1")
        said["particles"] = int(asked)
    for name, values in given.items():
        if values is not None and not is_law(values):
            shape = _numbers(name, values).shape
            if len(shape) == (2 if name in VECTORS else 1):
                said[name] = shape[0]
    if not said:
        return default
    first, count = next(iter(said.items()))
    for name, other in said.items():
        if other != count:
            raise ValueError(
                f"{name} are for {other} particles, but {first} for {count}; must be for as many"
            )
    if count < 1:
        raise ValueError(f"{first} are for no particle; must be for at least 1")
    return count


def read(name: str, given: Any, random: np.random.Generator, count: int) -> Floats:
    """Return the values of one argument, shape (count,), or (count, 3) for a vector.

    Parameters
    ----------
    name
        The argument, one of `UNITS`.
    given
        One value for all, an array, a frozen distribution, whose `rvs(size=..., random_state=...)`
        draws every component, or a function of (random, count).

    Raises
    ------
    ValueError
        If these are not as many finite numbers.
    """
    shape = (count, 3) if name in VECTORS else (count,)
    if hasattr(given, "rvs"):
        values = _numbers(name, given.rvs(size=shape, random_state=random))
    elif callable(given):
        values = _numbers(name, given(random, count))
    else:
        values = _numbers(name, given)
    if values.shape not in (shape, shape[1:]):
        one = "3 numbers" if name in VECTORS else "one number"
        raise ValueError(f"{name} have the shape {values.shape}; must be {shape}, or {one} for all")
    values = np.array(np.broadcast_to(values, shape))
    refuse(name, values, ~np.isfinite(values), "finite")
    return values


def refuse(name: str, values: Floats, wrong: npt.NDArray[np.bool_], allowed: str) -> None:
    """Raise a ValueError that shows the first of the `wrong` values and says what is `allowed`."""
    if wrong.any():
        place = tuple(int(index) for index in np.argwhere(wrong)[0])
        inside = ", ".join(map(str, place))
        raise ValueError(f"{name}[{inside}] is {values[place]:g} {UNITS[name]}; must be {allowed}")


def check_radii(radii: Floats, half_width: float) -> None:
    """Raise a ValueError if a sphere does not fit into the box."""
    allowed = f"greater than 0 m and less than half_width, {half_width:g} m"
    refuse("radii", radii, ~((radii > 0.0) & (radii < half_width)), allowed)


def check_positions(positions: Floats, half_width: float) -> None:
    """Raise a ValueError if a centre is outside the box."""
    allowed = f"from {-half_width:g} to {half_width:g} m"
    refuse("positions", positions, np.abs(positions) > half_width, allowed)


def check_temperatures(temperatures: Floats) -> None:
    """Raise a ValueError if a temperature is below zero."""
    refuse("temperatures", temperatures, temperatures < 0.0, "at least 0 K")


def read_grains(given: Any, count: int) -> npt.NDArray[np.int64]:
    """Return the grains in each of `count` particles; one in each if nothing is given."""
    if given is None:
        return np.ones(count, np.int64)
    grains = np.asarray(given)
    if grains.shape != (count,) or grains.dtype.kind not in "iu" or np.any(grains < 1):
        raise ValueError(
            f"grains are {given!r}; must be {count} whole numbers of at least 1, one per particle"
        )
    return grains.astype(np.int64)


def overlapping_pair(positions: Floats, radii: Floats, side: float, periodic: bool) -> str:
    """Name the first two spheres that overlap, and by how much."""
    for i in range(len(radii) - 1):
        away = positions[i + 1 :] - positions[i]
        if periodic:
            away -= side * np.rint(away / side)
        depth = radii[i] + radii[i + 1 :] - np.sqrt(np.sum(away**2, axis=1))
        j = int(np.argmax(depth))
        if depth[j] > 1e-12 * (radii[i] + radii[i + 1 + j]):
            return f"{i} and {i + 1 + j} overlap by {depth[j]:.3g} m"
    return "overlap"


def _numbers(name: str, values: Any) -> Floats:
    try:
        return np.asarray(values, dtype=np.float64)
    except (TypeError, ValueError):
        raise ValueError(
            f"{name} are {values!r}; must be numbers in {UNITS[name]}, a distribution with rvs, or "
            "a function of (random, count)"
        ) from None
