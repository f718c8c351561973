"""What becomes of a campaign file in which bits are flipped, each time in a process of its own.

Started as a program, because a process that has loaded little forks fast.
"""

import faulthandler
import json
import os
import resource
import signal
import sys
from pathlib import Path

from agglom_mpi.storage.access import NotACampaign
from agglom_mpi.storage.verify import verify_rows

SOUND, REFUSED, WRONG = range(3)
SECONDS = 5.0
"""Processor time after which SIGPROF ends a process that hangs."""
MEMORY = 1 << 30
"""Bytes that a process may have."""


def exit_code_of_reading(path):
    """Exit code of a process that reads a file: sound, refused in words, or less than 0, a crash.

    What is raised but a refusal in one line is wrong.
    """
    child = os.fork()
    if child == 0:
        faulthandler.disable()
        signal.setitimer(signal.ITIMER_PROF, SECONDS)
        resource.setrlimit(resource.RLIMIT_AS, (MEMORY, MEMORY))
        code = WRONG
        try:
            verify_rows(path)
            code = SOUND
        except NotACampaign as error:
            text = str(error)
            named = text.startswith(f"{path}: ") and text.count(path.name) == 1
            code = REFUSED if named and "\n" not in text else WRONG
        finally:
            os._exit(code)
    return os.waitstatus_to_exitcode(os.waitpid(child, 0)[1])


def main(path, cases):
    """Print the exit codes for cases, each a list of flips, (place, bit), of a file."""
    sound, found = path.read_bytes(), []
    for flips in cases:
        content = bytearray(sound)
        for place, bit in flips:
            content[place] ^= 1 << bit
        path.write_bytes(content)
        found.append(exit_code_of_reading(path))
    print(json.dumps(found))


if __name__ == "__main__":
    main(Path(sys.argv[1]), json.loads(Path(sys.argv[2]).read_text()))
