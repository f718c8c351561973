"""Functions that are limited to one BLAS thread call each other."""

from agglom_mpi.emulation.blas_threads import single_threaded


def test_a_limited_function_calls_another():
    @single_threaded
    def inner():
        return 1

    @single_threaded
    def outer():
        return inner() + 1

    assert outer() == 2
