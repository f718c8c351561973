"""Axes to draw into: those that are given, or new ones, and what all figures have in common."""

from typing import TYPE_CHECKING, Any, Final

from agglom_mpi.errors import require_library
from agglom_mpi.report.picture import SIZE

if TYPE_CHECKING:
    import matplotlib.figure

    from agglom_mpi.storage.reader import CampaignData

POWERS: Final = {"^2": "²", "^3": "³"}


SYMBOLS: Final = {"growth_target": "Λ", "maximum_growth": "Π"}
"""The papers' names of their objectives [A 26] [B 7.1]."""


def objective_label(data: "CampaignData") -> str:
    """Return the name of a campaign's objective on an axis, with its unit."""
    symbol = SYMBOLS.get(str(data.identity.get("objective.law")))
    return f"objective {symbol} (1)" if symbol else "objective (1)"


def axes_for(ax: Any | None, size: tuple[float, float] = SIZE) -> Any:
    """Return the axes, or those of a new figure of pyplot's if None."""
    if ax is not None:
        return ax
    return figure_for(None, size).subplots()


def figure_for(figure: Any | None, size: tuple[float, float]) -> "matplotlib.figure.Figure":
    """Return the figure, or a new one of pyplot's of so many inches if None."""
    if figure is not None:
        return figure
    check_drawing()
    from matplotlib import pyplot

    return pyplot.figure(figsize=size, layout="constrained")


def check_drawing() -> None:
    """Raise a MissingLibraryError, an ImportError, if matplotlib is not installed."""
    require_library("matplotlib", "report", "figures")


def grid(ax: Any) -> None:
    """Draw a faint grid behind everything, and no frame at the top and right."""
    ax.grid(True, which="major", color="0.9", linewidth=0.6)
    ax.set_axisbelow(True)
    ax.spines[["top", "right"]].set_visible(False)


def say(ax: Any, text: str) -> None:
    """Write why there is nothing to see into empty axes."""
    ax.text(0.5, 0.5, text, transform=ax.transAxes, ha="center", va="center", color="0.35")
    ax.set_xticks([])
    ax.set_yticks([])


def whole_numbers(axis: Any) -> None:
    """Let an axis have its ticks at whole numbers."""
    from matplotlib.ticker import MaxNLocator

    axis.set_major_locator(MaxNLocator(integer=True, nbins="auto"))


def legend_below(ax: Any, columns: int = 2) -> None:
    """Put the legend under the axes, where it hides nothing."""
    ax.legend(
        loc="upper center",
        bbox_to_anchor=(0.5, -0.2),
        ncols=columns,
        frameon=False,
        fontsize="small",
    )


def in_unit(unit: str, largest: float) -> tuple[float, str]:
    """Return the size of the decimal multiple of a unit that suits such values, and its name.

    >>> in_unit("Pa", 2e8)
    (1000000.0, 'MPa')
    >>> in_unit("kg/m^3", 1e4)
    (1.0, 'kg/m³')
    """
    name = unit
    for ascii_power, power in POWERS.items():
        name = name.replace(ascii_power, power)
    if unit.startswith(("Pa", "J")):
        for size, prefix in ((1e15, "P"), (1e12, "T"), (1e9, "G"), (1e6, "M"), (1e3, "k")):
            if largest >= 1.5 * size:
                return size, f"{prefix}{name}"
    return 1.0, name


def label(name: str, unit: str) -> str:
    """Return the label of an axis."""
    return f"{name.replace('_', ' ')} ({unit})"
