"""Frames on the way of both published steppers, between the beginning and the end of a step."""

from agglom_mpi.compilation import rare_stage, stage
from agglom_mpi.simulation.recorder import copy_all, finish, next_frame
from agglom_mpi.simulation.stepping import cool, move


@stage
def record_step(recorder, scene, particles, begin, step, end):  # type: ignore[no-untyped-def]
    """Take the frames after `begin` and up to `end` in s, between which all move for `step` in s.

    Those at `begin` are taken: contacts come first in a step, and a run that ends has none more.
    """
    if recorder is not None:
        time = next_frame(recorder, scene.end_time)
        while time <= end:
            flight = step if time == end else min(step, time - begin)
            take_in_step(recorder, scene, particles, flight, time)
            time = next_frame(recorder, scene.end_time)


@rare_stage
def take_in_step(recorder, scene, particles, flight, time):  # type: ignore[no-untyped-def]
    """Take the frame at `time` in s, to which all move for `flight` in s."""
    copy_in_step(recorder, scene, particles, flight)
    finish(recorder, scene, time)


@stage
def copy_in_step(recorder, scene, particles, flight):  # type: ignore[no-untyped-def]
    """Copy the particles, and let the copies move for `flight` in s."""
    copy = copy_all(recorder, particles)
    move(scene, copy, flight)
    cool(scene.cooling, scene, copy, recorder.ledger, flight)
