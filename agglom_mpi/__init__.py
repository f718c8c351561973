"""MPI-parallel batch inversion of agglomerating granular flows.

From Python, eleven names:

    load_campaign("campaign.yaml")     read a campaign file: what is asked, in which scene
        .describe()                    say what would run, and what follows from its numbers
        .simulate(values)              simulate one sample of a string of values
        .simulate_many(strings)        simulate samples of many strings on all cores
        .estimate(values, samples)     mean ± standard error of a string
        .run(ranks=2)                  search the string that the objective wants
        .searcher()                    the same search, for strings that you judge: ask and tell
    open_campaign("campaign.h5")       read what a run found: tables, figures, the best strings
        .feasible_set()                all strings that are compatible with the objective
    compare_laws(["a.h5", "b.h5"])     say which of several laws explains the same data
    load_emulator("campaign.h5")       growth, and measured data, of any string, emulated
    Box("campaign.yaml", values)       a box of grains inside a macroscopic model

`help(agglom_mpi.load_campaign)`, and so on, explains each with an example. Values are SI numbers or
texts with units: `{"relative_speed": 4.3, "hardness": "67 MPa"}`.
"""

from typing import TYPE_CHECKING, Any

from agglom_mpi.version import __version__

if TYPE_CHECKING:
    from agglom_mpi.campaign_file import compare_laws, open_campaign
    from agglom_mpi.campaign_runs import load_campaign
    from agglom_mpi.coupling.box import Box
    from agglom_mpi.inference.emulator_file import load_emulator

__all__ = [
    "Box",
    "__version__",
    "compare_laws",
    "load_campaign",
    "load_emulator",
    "open_campaign",
]


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
    if name == "compare_laws":
        from agglom_mpi.campaign_file import compare_laws

        return compare_laws
    if name == "load_emulator":
        from agglom_mpi.inference.emulator_file import load_emulator

        return load_emulator
    if name == "Box":
        from agglom_mpi.coupling.box import Box

        return Box
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
