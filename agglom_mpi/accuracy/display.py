"""What a study shows while it runs: set-ups done of all of them."""

from typing import TYPE_CHECKING

from agglom_mpi.display.display import Display

if TYPE_CHECKING:
    from agglom_mpi.search.decisions import GenerationSummary


class StudyDisplay(Display):
    """Says nothing of generations: all set-ups are one."""

    def generation(
        self, summary: "GenerationSummary", total: int, samples: int, rate: float
    ) -> None:
        """There is nothing to say at its end."""
