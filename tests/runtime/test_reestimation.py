"""Which fresh samples are asked for, which are there, and which are missing; without files."""

import tracemalloc

import numpy as np
import pytest

from agglom_mpi.runtime.experiment import ReestimationPlan
from agglom_mpi.runtime.post_stages import ReestimationStage
from agglom_mpi.scheduling.static_scheduler import StaticScheduler
from agglom_mpi.storage.schema import sample_dtype
from agglom_mpi.variables import TEN

WANTED = ReestimationPlan((7, 2), 3)
ALL = [(7, 20), (7, 21), (7, 22), (2, 20), (2, 21), (2, 22)]


def parameters(string):
    return np.full(TEN.count, float(string))


def reestimation(known=(), wanted=WANTED, room=30):
    pairs = np.array([*known], np.int64).reshape(-1, 2)
    return ReestimationStage(wanted, 20, room, pairs, parameters)


def pairs(tasks):
    return [
        (int(task["string"]), sample)
        for task in tasks
        for sample in range(task["first"], task["first"] + task["count"])
    ]


def rows(*keys):
    made = np.zeros(len(keys), sample_dtype)
    made["string"], made["sample"] = np.array(keys).T
    return made


def test_all_are_simulated_the_best_string_first():
    stage = reestimation()
    tasks = stage.open()
    assert pairs(tasks) == ALL
    assert tasks[["string", "count", "frames"]].tolist() == [(7, 3, 0), (2, 3, 0)]
    assert tasks["parameters"][:, 0].tolist() == [7, 2]
    assert stage.announcement(tasks) == "estimating 2 strings again, on 6 fresh samples"
    stage.take(rows(*ALL[:5]))
    assert not stage.complete
    stage.take(rows(ALL[5]))
    assert stage.complete


def test_what_is_known_is_not_simulated_again():
    stage = reestimation({(7, 21), (2, 20), (3, 20), (7, 5)})
    assert not stage.complete
    assert pairs(stage.open()) == [(7, 20), (7, 22), (2, 21), (2, 22)]
    assert reestimation(ALL).complete
    assert len(reestimation(ALL).open()) == 0


@pytest.mark.parametrize(("room", "some"), [(20, []), (21, [(7, 20), (2, 20)]), (30, ALL)])
def test_there_are_as_many_as_there_is_room_for(room, some):
    assert pairs(reestimation(room=room).open()) == some
    assert reestimation(some, room=room).complete


def test_where_none_are_asked_for_there_is_nothing_to_do():
    assert reestimation(wanted=ReestimationPlan()).complete


def test_millions_of_samples_cost_a_byte_each():
    tracemalloc.start()
    stage = reestimation(wanted=ReestimationPlan((7, 2), 10**6), room=2 * 10**6)
    scheduler = StaticScheduler(stage.open(), 4)
    _, most = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert most < 4 * 2 * 10**6
    assert stage.stage == (0, 2 * 10**6, "fresh samples", False, False)
    assert len(list(scheduler.assignments(0.0))) == 8
