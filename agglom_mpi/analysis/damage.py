"""Whether a campaign file is to blame for an error while it was read."""

import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from agglom_mpi.errors import FINISHED, UserError
from agglom_mpi.storage.access import SYMPTOMS, DamagedCampaign


@contextmanager
def blame_damage(*paths: str | os.PathLike[str]) -> Iterator[None]:
    """Turn an error while campaign files are evaluated into a DamagedCampaign, if one is damaged.

    Rows may have right checksums and still contradict each other in more ways than every table and
    figure can foresee. Whether they do, the verification of the file says; an error in spite of a
    sound file is one of this program, and is raised as it is.
    """
    try:
        yield
    except UserError:
        raise
    except SYMPTOMS as error:
        if isinstance(error, OSError):
            raise
        # Imported here: it loads what decides a search.
        from agglom_mpi.analysis.file_check import check_file

        for path in map(Path, paths):
            if check_file(str(path))[1] != FINISHED:
                text = f"{path}: a damaged campaign file; agglom check {path} says what is wrong"
                raise DamagedCampaign(text) from error
        raise
