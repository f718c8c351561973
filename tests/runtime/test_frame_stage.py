"""Which pictures are asked for, which are there, and which are missing; without files or ranks."""

import numpy as np
import pytest

from agglom_mpi.runtime.experiment import FramePlan
from agglom_mpi.runtime.post_stages import FrameStage
from agglom_mpi.simulation.frames import new_frames
from agglom_mpi.storage.particle_tables import frame_rows
from agglom_mpi.variables import TEN

FRAMES = 3
WANTED = FramePlan(((7, 0), (7, 1), (2, 0)), FRAMES)


class FramesInMemory:
    """A writer, and its writer of frames, that keep the keys of frames in memory, by row."""

    def __init__(self, *samples):
        self.frames = self
        self.kept = {}
        self.forgotten = 0
        for place, pair in enumerate(samples):
            self.keep(place, *pair)

    def keep(self, place, string, sample, frames=range(FRAMES)):
        self.kept |= {place * FRAMES + frame: (string, sample, frame) for frame in frames}

    def keys(self):
        return dict(self.kept)

    def forget(self):
        self.kept.clear()
        self.forgotten += 1

    def put(self, first, rows):
        found = rows[["string", "sample", "frame"]].tolist()
        self.kept |= {first + i: key for i, key in enumerate(found)}


def parameters(string):
    return np.full(TEN.count, float(string))


def rows(string, sample):
    return frame_rows(string, sample, new_frames(np.arange(float(FRAMES)), 5))


def open_stage(writer, pictures=WANTED):
    stage = FrameStage(pictures, writer, parameters)
    return stage, stage.open()


def pairs(tasks):
    return [(int(task["string"]), int(task["first"])) for task in tasks]


def test_all_are_taken_in_order_where_there_are_none():
    writer = FramesInMemory()
    stage, tasks = open_stage(writer)
    assert pairs(tasks) == list(WANTED.samples)
    assert tasks["frames"].tolist() == [FRAMES] * 3
    for task in tasks:
        assert task["parameters"].tolist() == parameters(task["string"]).tolist()
    for pair in reversed(WANTED.samples):
        assert not stage.complete
        stage.store(rows(*pair))
    assert stage.complete
    assert writer.kept == FramesInMemory(*WANTED.samples).kept
    assert writer.forgotten == 0


def test_frames_may_arrive_one_by_one():
    writer = FramesInMemory((7, 0), (7, 1))
    stage, tasks = open_stage(writer)
    assert pairs(tasks) == [(2, 0)]
    for frame in range(FRAMES):
        assert not stage.complete
        stage.store(rows(2, 0)[frame : frame + 1])
    assert stage.complete
    assert writer.kept == FramesInMemory(*WANTED.samples).kept


def test_nothing_is_missing_where_all_are_there():
    stage, tasks = open_stage(FramesInMemory(*WANTED.samples))
    assert stage.complete
    assert len(tasks) == 0


def test_a_sample_of_which_one_picture_is_missing_is_taken_again():
    writer = FramesInMemory(*WANTED.samples)
    del writer.kept[4]
    stage, tasks = open_stage(writer)
    assert pairs(tasks) == [(7, 1)]
    assert not stage.complete
    assert writer.forgotten == 0


@pytest.mark.parametrize(
    "stored",
    [
        [(7, 0), (2, 0), (7, 1)],
        [(7, 0), (7, 1), (3, 0)],
        [(7, 0), (7, 1), (2, 0), (3, 0)],
        [(4, 0)],
    ],
)
def test_pictures_of_others_are_dropped_before_any_is_taken(stored):
    writer = FramesInMemory(*stored)
    stage = FrameStage(WANTED, writer, parameters)
    assert not stage.complete
    assert writer.kept, "asking changes nothing"
    assert pairs(stage.open()) == list(WANTED.samples)
    assert (writer.kept, writer.forgotten) == ({}, 1)
    for pair in WANTED.samples:
        stage.store(rows(*pair))
    assert stage.complete


def test_fewer_frames_of_the_same_sample_are_dropped_and_more_taken_all():
    one = FramePlan(((7, 0),), FRAMES)
    writer = FramesInMemory()
    writer.keep(0, 7, 0, range(FRAMES + 1))
    assert pairs(open_stage(writer, one)[1]) == [(7, 0)]
    assert writer.forgotten == 1
    writer = FramesInMemory()
    writer.keep(0, 7, 0, range(FRAMES - 1))
    _, [task] = open_stage(writer, one)
    assert task["frames"] == FRAMES
    # Frames at other times: evenly spaced, all but the first have moved.


def test_a_sample_that_raised_is_given_up_until_the_next_run():
    writer = FramesInMemory((7, 0))
    stage, _ = open_stage(writer)
    stage.give_up(7, 1)
    assert not stage.complete
    stage.store(rows(2, 0))
    assert stage.complete
    assert pairs(open_stage(writer)[1]) == [(7, 1)]


def test_where_none_are_asked_for_those_there_are_stay():
    writer = FramesInMemory((7, 0))
    stage, tasks = open_stage(writer, FramePlan())
    assert stage.complete
    assert len(tasks) == 0
    assert writer.forgotten == 0
