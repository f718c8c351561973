"""Wall-clock time counts waiting; processor time is that of one thread alone."""

import threading
import time
from types import SimpleNamespace

from agglom_mpi import stopwatch
from agglom_mpi.stopwatch import Stopwatch

NAP = 0.05


def test_time_spent_waiting_is_no_processor_time():
    watch = Stopwatch()
    time.sleep(NAP)
    spent = watch.read()
    assert spent.wall >= NAP
    assert 0.0 <= spent.cpu < 0.5 * spent.wall


def test_the_work_of_another_thread_is_not_counted():
    over = threading.Event()

    def work():
        while not over.is_set():
            sum(range(1000))

    worker = threading.Thread(target=work)
    watch = Stopwatch()
    worker.start()
    time.sleep(NAP)
    over.set()
    worker.join()
    spent = watch.read()
    assert spent.wall >= NAP
    assert spent.cpu < 0.5 * spent.wall


def test_both_clocks_are_read_from_the_start(monkeypatch):
    now = SimpleNamespace(wall=10.0, cpu=3.0)
    clocks = SimpleNamespace(perf_counter=lambda: now.wall, thread_time=lambda: now.cpu)
    monkeypatch.setattr(stopwatch, "time", clocks)
    watch = Stopwatch()
    now.wall, now.cpu = 12.5, 3.25
    assert watch.read() == (2.5, 0.25)
