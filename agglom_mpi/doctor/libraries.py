"""Python, the package, and what it is installed with or without."""

import platform
from collections.abc import Iterator
from importlib.metadata import PackageNotFoundError, version
from typing import Final

from agglom_mpi import __version__
from agglom_mpi.doctor.finding import Finding

EXTRAS: Final = {
    "report": ("pandas", "matplotlib"),
    "search": ("scipy", "cmaes", "threadpoolctl"),
}
"""Libraries of the extras, and what is missed without them."""
NEEDED_FOR: Final = {
    "report": "tables and figures",
    "search": "the searches surrogate, cmaes and sobol, and the sensitivity",
}


def look() -> Iterator[Finding]:
    """Tell versions, and which extras are not there."""
    core = ", ".join(f"{name} {version(name)}" for name in ("numpy", "numba", "mpi4py"))
    yield Finding("agglom_mpi", f"{__version__}, Python {platform.python_version()}, {core}")
    yield _hdf5()
    for extra, names in EXTRAS.items():
        missing = [name for name in names if not _installed(name)]
        if missing:
            advice = f"for {NEEDED_FOR[extra]}: pip install 'agglom_mpi[{extra}]'"
            yield Finding(f"extra {extra}", f"without {', '.join(missing)}", advice)
        else:
            found = ", ".join(f"{name} {version(name)}" for name in names)
            yield Finding(f"extra {extra}", found)


def _hdf5() -> Finding:
    import h5py

    parallel = bool(h5py.get_config().mpi)
    writers = "every rank can write" if parallel else "built without MPI: rank 0 writes for all"
    return Finding("h5py", f"{h5py.__version__}, HDF5 {h5py.version.hdf5_version}, {writers}")


def _installed(name: str) -> bool:
    try:
        version(name)
    except PackageNotFoundError:
        return False
    return True
