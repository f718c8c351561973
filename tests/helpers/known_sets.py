"""Sets and posteriors of files that tests only read: commands compute each once in a process."""

from importlib import import_module

PLACES = {
    "FeasibleSet": ("report.set_files",),
    "feasible_set": ("report.netcdf",),
    "data_posterior": (
        *("inference.data_posterior", "report.netcdf", "report.page", "report.set_files"),
    ),
}
"""Modules of the package that make them, by the name that is called there."""
_KNOWN = {}


def remember_sets(monkeypatch):
    """Let reports take what another one has computed of the same file with the same arguments."""
    for name, places in PLACES.items():
        for place in places:
            module = import_module(f"agglom_mpi.{place}")
            monkeypatch.setattr(module, name, _remembered(name, getattr(module, name)))


def _remembered(name, made):
    def known(data, *arguments, **options):
        key = (name.lower().replace("_", ""), str(data.path), repr((arguments, options)))
        if key not in _KNOWN:
            _KNOWN[key] = made(data, *arguments, **options)
        return _KNOWN[key]

    return known
