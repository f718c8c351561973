"""MPI-parallel batch inversion of agglomerating granular flows.

`load_campaign(yaml)` simulates or runs what a campaign file describes, `open_campaign(h5)` reads
what a campaign found, and `Box` is a box of grains inside a macroscopic model.
"""

from typing import TYPE_CHECKING, Any

from agglom_mpi.version import __version__

if TYPE_CHECKING:
    from agglom_mpi.campaign_file import open_campaign
    from agglom_mpi.campaign_runs import load_campaign
    from agglom_mpi.coupling.box import Box

__all__ = ["Box", "__version__", "load_campaign", "open_campaign"]


def __dir__() -> list[str]:
    """Return the public names, which are imported when they are first used."""
    return sorted(__all__)


def __getattr__(name: str) -> Any:
    """Import the entry points when they are first used, so that importing the package is free."""
    if name == "load_campaign":
        from agglom_mpi.campaign_runs import load_campaign

        return load_campaign
    if name == "open_campaign":
        from agglom_mpi.campaign_file import open_campaign

        return open_campaign
    if name == "Box":
        from agglom_mpi.coupling.box import Box

        return Box
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
