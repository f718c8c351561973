"""Workers of a test run that need the same kernel at once: one compiles it, the others load it."""

import functools
import hashlib

from numba.core.caching import NullCache
from numba.core.dispatcher import Dispatcher
from once import locked


def share_compilations(folder):
    """Let only one process at a time compile a kernel for the same types; files in `folder`."""
    compile_alone = Dispatcher.compile

    @functools.wraps(compile_alone)
    def compile_in_turn(self, signature):
        if isinstance(self._cache, NullCache):
            return compile_alone(self, signature)
        name = hashlib.sha256(f"{self.py_func.__qualname__}{signature}".encode()).hexdigest()
        with locked(folder / f"{name[:32]}.kernel"):
            return compile_alone(self, signature)

    Dispatcher.compile = compile_in_turn
