"""Which pictures are asked for, which are there, and which are missing; without files or ranks."""

import numpy as np
import pytest

from agglom_mpi.runtime.experiment import FramePlan
from agglom_mpi.runtime.post_stages import FrameStage
from agglom_mpi.simulation.frames import new_frames
from agglom_mpi.storage.particle_tables import frame_rows
from agglom_mpi.variables import COUNT

FRAMES = 3
WANTED = FramePlan(((7, 0), (7, 1), (2, 0)), FRAMES)


class Album:
    """A writer that keeps the keys of pictures in memory, by row."""

    def __init__(self, *samples):
        self.keys = {}
        self.forgotten = 0
        for place, pair in enumerate(samples):
            self.keep(place, *pair)

    def keep(self, place, string, sample, frames=range(FRAMES)):
        self.keys |= {place * FRAMES + frame: (string, sample, frame) for frame in frames}

    def frame_keys(self):
        return dict(self.keys)

    def forget_frames(self):
        self.keys.clear()
        self.forgotten += 1

    def put_frames(self, first, rows):
        found = rows[["string", "sample", "frame"]].tolist()
        self.keys |= {first + i: key for i, key in enumerate(found)}


def parameters(string):
    return np.full(COUNT, float(string))


def rows(string, sample):
    return frame_rows(string, sample, new_frames(np.arange(float(FRAMES)), 5))


def open_gallery(album, pictures=WANTED):
    gallery = FrameStage(pictures, album, parameters)
    return gallery, gallery.open()


def pairs(tasks):
    return [(int(task["string"]), int(task["first"])) for task in tasks]


def test_all_are_taken_in_order_where_there_are_none():
    album = Album()
    gallery, tasks = open_gallery(album)
    assert pairs(tasks) == list(WANTED.samples)
    assert tasks["frames"].tolist() == [FRAMES] * 3
    for task in tasks:
        assert task["parameters"].tolist() == parameters(task["string"]).tolist()
    for pair in reversed(WANTED.samples):
        assert not gallery.done
        gallery.store(rows(*pair))
    assert gallery.done
    assert gallery.complete
    assert album.keys == Album(*WANTED.samples).keys
    assert album.forgotten == 0


def test_frames_may_arrive_one_by_one():
    album = Album((7, 0), (7, 1))
    gallery, tasks = open_gallery(album)
    assert pairs(tasks) == [(2, 0)]
    for frame in range(FRAMES):
        assert not gallery.complete
        gallery.store(rows(2, 0)[frame : frame + 1])
    assert gallery.complete
    assert album.keys == Album(*WANTED.samples).keys


def test_nothing_is_missing_where_all_are_there():
    gallery, tasks = open_gallery(Album(*WANTED.samples))
    assert gallery.complete
    assert gallery.done
    assert len(tasks) == 0


def test_a_sample_of_which_one_picture_is_missing_is_taken_again():
    album = Album(*WANTED.samples)
    del album.keys[4]
    gallery, tasks = open_gallery(album)
    assert pairs(tasks) == [(7, 1)]
    assert not gallery.complete
    assert album.forgotten == 0


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
    album = Album(*stored)
    gallery = FrameStage(WANTED, album, parameters)
    assert not gallery.complete
    assert not gallery.done
    assert album.keys, "asking changes nothing"
    assert pairs(gallery.open()) == list(WANTED.samples)
    assert (album.keys, album.forgotten) == ({}, 1)
    for pair in WANTED.samples:
        gallery.store(rows(*pair))
    assert gallery.complete


def test_fewer_frames_of_the_same_sample_are_dropped_and_more_taken_all():
    one = FramePlan(((7, 0),), FRAMES)
    album = Album()
    album.keep(0, 7, 0, range(FRAMES + 1))
    assert pairs(open_gallery(album, one)[1]) == [(7, 0)]
    assert album.forgotten == 1
    album = Album()
    album.keep(0, 7, 0, range(FRAMES - 1))
    _, [task] = open_gallery(album, one)
    assert task["frames"] == FRAMES
    # Frames at other times: evenly spaced, all but the first have moved.


def test_a_sample_that_raised_is_given_up_until_the_next_run():
    album = Album((7, 0))
    gallery, _ = open_gallery(album)
    gallery.give_up(7, 1)
    assert not gallery.done
    gallery.store(rows(2, 0))
    assert gallery.done
    assert pairs(open_gallery(album)[1]) == [(7, 1)]


def test_where_none_are_asked_for_those_there_are_stay():
    album = Album((7, 0))
    gallery, tasks = open_gallery(album, FramePlan())
    assert gallery.complete
    assert gallery.done
    assert len(tasks) == 0
    assert album.forgotten == 0
