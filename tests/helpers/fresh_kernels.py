"""Programs that compile kernels of their own, whatever was compiled before."""

import os
import re
import sys

from processes import output_of, program


def said_by(code, folder, *arguments, checked=True):
    """Return what code prints in a fresh process, whose kernels may check their indices."""
    words = [sys.executable, "-c", code, *arguments]
    kernels = folder / ("checked" if checked else "kernels")
    variables = {"NUMBA_CACHE_DIR": str(kernels), "NUMBA_BOUNDSCHECK": str(int(checked))}
    with program(words, env=os.environ | variables, cwd=folder) as process:
        said, complaint = output_of(process)
    assert process.returncode == 0, complaint
    return said


def with_escape(job, escape, folder):
    """Write a campaign of a file with other faces of its box; return the path."""
    path = folder / "campaign.yaml"
    path.write_text(re.sub(r"(?m)^( *escape: )\w+", rf"\g<1>{escape}", job.read_text()))
    return path
