"""Linear algebra that gives the same bits on any number of cores, and leaves them to others."""

from collections.abc import Callable
from functools import wraps
from threading import Lock
from typing import Final, ParamSpec, TypeVar

Result = TypeVar("Result")
Arguments = ParamSpec("Arguments")

ALONE: Final = Lock()
"""Held by who has set the limit, which is the whole process's: who lifts it changes the sums of
all threads."""


def single_threaded(method: Callable[Arguments, Result]) -> Callable[Arguments, Result]:
    """Let the linear algebra of a method use one thread, and no two such methods run at once."""

    @wraps(method)
    def limited(*args: Arguments.args, **kwargs: Arguments.kwargs) -> Result:
        import scipy.linalg  # noqa: F401  (what is loaded later would not be limited)
        from threadpoolctl import threadpool_limits

        with ALONE, threadpool_limits(1):
            return method(*args, **kwargs)

    return limited
