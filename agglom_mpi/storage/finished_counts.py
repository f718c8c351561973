"""Counts of rows in the status of a finished campaign, with which its file can be compared.

The reason in `/status` is a sentence for people, which ends with these counts.
"""

import re
from typing import NamedTuple, Self

from agglom_mpi.formatting import pluralise


class FinishedCounts(NamedTuple):
    """Numbers of rows that a finished file has; None where its status does not state one.

    Attributes
    ----------
    generations
        All that were asked for; None if the search reached its target before.
    strings, samples
        Strings that were estimated again, and fresh samples of each.
    volumes
        Larger control volumes in which they were estimated, too; empty if there are none.
    frames
        Rows of `/frames`.
    """

    generations: int | None = None
    strings: int | None = None
    samples: int | None = None
    frames: int | None = None
    volumes: tuple[int, ...] = ()

    @classmethod
    def of_reason(cls, reason: str) -> Self:
        """Return the counts that a reason states."""
        generations = re.match(r"all (\d+) generations are|the (1) generation is", reason)
        fresh = re.search(r"; estimated again: (\d+|none)(?: strings? on (\d+) fresh)?", reason)
        frames = re.search(r"; (\d+) frames? stored", reason)
        volumes = re.search(r", volumes 1((?: \d+)+)(?=;|$)", reason)
        return cls(
            int(generations[1] or generations[2]) if generations else None,
            int(fresh[1].replace("none", "0")) if fresh else None,
            int(fresh[2] or 0) if fresh else None,
            int(frames[1]) if frames else None,
            tuple(map(int, volumes[1].split())) if volumes else (),
        )


def finished_reason(
    reason: str,
    strings: int,
    samples: int,
    frames: int,
    room: int = 0,
    volumes: tuple[int, ...] = (),
) -> str:
    """Return why a search ended, and what was stored after its end, as `/status` has it.

    Parameters
    ----------
    reason
        The first part.
    strings, samples
        Strings that were estimated again, and fresh samples of each; 0 if none were.
    frames
        Rows of `/frames`.
    room
        Fresh samples of each string that there is room for.
    volumes
        Larger control volumes in which they were estimated again, too.
    """
    if strings and samples:
        again = pluralise(strings, "string")
        reason += f"; estimated again: {again} on {pluralise(samples, 'fresh sample')}"
        reason += " each" if strings > 1 else ""
        reason += f", volumes {' '.join(map(str, (1, *volumes)))}" if volumes else ""
    elif room:
        reason += "; estimated again: none"
    return f"{reason}; {pluralise(frames, 'frame')} stored" if frames else reason
