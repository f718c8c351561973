"""What a run is to do."""

from pathlib import Path
from typing import NamedTuple

from agglom_mpi.farm.work import Work


class Order(NamedTuple):
    """Work and the file that keeps it.

    `accept_code_change` says whether samples of other sources may be in there, `database` who
    writes samples, None for what suits.
    """

    work: Work
    path: Path
    accept_code_change: bool
    database: str | None = None
