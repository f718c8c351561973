"""Whether a file is HDF5, asked before HDF5 is loaded."""

import os
from pathlib import Path
from typing import Final

SIGNATURE: Final = b"\x89HDF\r\n\x1a\n"


def is_hdf5(path: str | os.PathLike[str]) -> bool:
    """Whether a path is to be read as HDF5: by its name, or by what the file begins with.

    A pipe, which can be read only once, is not looked into: HDF5 cannot be read from one.
    """
    path = Path(path)
    if path.suffix == ".h5":
        return True
    try:
        if not path.is_file():
            return False
        with path.open("rb") as file:
            return file.read(len(SIGNATURE)) == SIGNATURE
    except OSError:
        return False
