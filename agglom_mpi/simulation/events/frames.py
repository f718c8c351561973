"""Frames between two events, where everybody flies straight on."""

from agglom_mpi.compilation import rare_stage, stage
from agglom_mpi.simulation.box import drawn_in
from agglom_mpi.simulation.recorder import copy_all, finish, next_frame


@stage
def record_flight(recorder, scene, particles, movers, following):  # type: ignore[no-untyped-def]
    """Take the frames before the `following` event, whose time is in s."""
    if recorder is not None:
        while next_frame(recorder, scene.end_time) < following:
            take_in_flight(recorder, scene, particles, movers)


@rare_stage
def take_in_flight(recorder, scene, particles, movers):  # type: ignore[no-untyped-def]
    """Take the next frame, before which nothing happens any more."""
    time = next_frame(recorder, scene.end_time)
    copy_in_flight(recorder, scene, particles, movers, time)
    finish(recorder, scene, time)


@rare_stage
def copy_in_flight(recorder, scene, particles, movers, time):  # type: ignore[no-untyped-def]
    """Copy the particles to where they are at `time` in s, before which nothing happens."""
    copy = copy_all(recorder, particles)
    for i in range(copy.size[0]):
        if copy.mass[i] > 0.0:
            copy_position(scene, copy, movers, i, time)


@stage
def copy_position(scene, copy, movers, i, now):  # type: ignore[no-untyped-def]
    """Put the copy of particle i where the particle is at `now` in s, and leave its path alone."""
    path, r, half = movers.path[i], copy.position, scene.half_width
    flight = now - path["time"]
    r[0, i] = drawn_in(scene.escape, path["x"] + path["u"] * flight, half)
    r[1, i] = drawn_in(scene.escape, path["y"] + path["v"] * flight, half)
    r[2, i] = drawn_in(scene.escape, path["z"] + path["w"] * flight, half)
