"""One thread of linear algebra at a time, in the whole process."""

from collections.abc import Callable
from functools import wraps
from threading import RLock
from typing import Final, ParamSpec, TypeVar

from threadpoolctl import threadpool_limits

Result = TypeVar("Result")
Arguments = ParamSpec("Arguments")

BLAS_LIMIT_LOCK: Final = RLock()
"""Lock held while the number of threads is limited.

The limit is that of the whole process; lifting it changes the order of summation in all threads.
One limited function may call another.
"""


def single_threaded(method: Callable[Arguments, Result]) -> Callable[Arguments, Result]:
    """Decorate a function to use one BLAS thread, and never to run beside another such function.

    The matrices are small. A second thread gains little, and where a campaign keeps all cores busy,
    two threads wait for each other many times as long as either computes.
    """

    @wraps(method)
    def limited(*args: Arguments.args, **kwargs: Arguments.kwargs) -> Result:
        import scipy.linalg  # noqa: F401  (a library that is loaded later would not be limited)

        with BLAS_LIMIT_LOCK, threadpool_limits(1):
            return method(*args, **kwargs)

    return limited
