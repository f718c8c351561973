"""Processors: how many there are, may be used, and would be fought over."""

import os
from collections.abc import Iterator, Mapping
from typing import Final

from agglom_mpi.doctor.finding import Finding
from agglom_mpi.farm.launch import promised_size
from agglom_mpi.farm.store import processor

THREADS: Final = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS")


def look(environment: Mapping[str, str] = os.environ) -> Iterator[Finding]:
    """Compare processors with ranks and threads."""
    there, usable = os.cpu_count() or 1, len(os.sched_getaffinity(0))
    found = f"{there} of {processor()}" + (f", {usable} usable here" if usable < there else "")
    ranks = promised_size(environment)
    advice = ""
    if ranks is not None and ranks > there and environment.get("SLURM_NNODES", "1") == "1":
        advice = f"{ranks} ranks on them: no more than {there} are of use"
    elif ranks is not None and usable < 2:
        advice = (
            "ranks are bound to one core each: right where each has its own; "
            "if not, OMPI_MCA_hwloc_base_binding_policy=none"
        )
    yield Finding("processors", found, advice)
    many = [f"{n}={environment[n]}" for n in THREADS if environment.get(n, "") not in ("", "1")]
    if many:
        advice = "the parallelism is in the ranks: set them to 1, they only cost"
        yield Finding("threads", ", ".join(many), advice)
