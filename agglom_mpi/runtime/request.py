"""What all ranks are told to do."""

from pathlib import Path
from typing import NamedTuple

from agglom_mpi.runtime.experiment import Experiment


class Order(NamedTuple):
    """Work and the file that keeps it.

    `accept_code_change` says whether samples of other sources may be in there, `database` who
    writes samples, None for what suits.
    """

    work: Experiment
    path: Path
    accept_code_change: bool
    database: str | None = None
