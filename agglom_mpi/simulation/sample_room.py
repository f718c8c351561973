"""Arrays that the samples of a thread use one after another, and the kernels that work on them."""

import threading
from dataclasses import dataclass
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from agglom_mpi.compilation.kernel_calls import CALLEE, callee_of
from agglom_mpi.outcome import outcome_type
from agglom_mpi.simulation.census import EXAMPLE_LAYOUT, new_census_room, take_census
from agglom_mpi.simulation.initial_state import DifferentSizes, EqualSizes, scatter
from agglom_mpi.simulation.particles import Ledger, Particles, new_ledger, new_particles
from agglom_mpi.simulation.sample_kernels import INITIAL, measure_sample, run_engine
from agglom_mpi.simulation.scene import Scene, new_engine_state
from agglom_mpi.simulation.trajectory import Observer, new_observer

PLACEMENT: Final = "placement"
MEASUREMENT: Final = "measurement"
ENGINE: Final = "engine"
CENSUS: Final = "census"
"""Names of the kernels of a sample; `CENSUS` only where censuses are taken."""

CALLED: Final = (PLACEMENT, ENGINE, MEASUREMENT, CENSUS)
"""The kernels in `Room.callees`."""


class Room(NamedTuple):
    """Arrays for the samples of a kind of scene, of which each finds what the one before has left.

    Attributes
    ----------
    particles, ledger, engine_state, initial
        As for `run_engine`.
    template
        Record of a grain before it is placed, shape (1,).
    placed, velocity
        Positions in m and velocities in m/s of the grains, shape (3, N).
    record
        Result of the sample under way, of `outcome_type`, shape (1,).
    timespec
        Answer of a clock, shape (2,).
    callees
        Kernels of a sample, `CALLEE`, shape (4,).
    observer
        Copies of the particles of which censuses are taken; None where there are none.
    """

    particles: Particles
    ledger: Ledger
    engine_state: Any
    initial: NDArray[Any]
    template: NDArray[Any]
    placed: NDArray[np.float64]
    velocity: NDArray[np.float64]
    record: NDArray[Any]
    timespec: NDArray[np.int64]
    callees: NDArray[Any]
    observer: Observer | None = None


def new_room(
    scene: Scene, engine_state: Any, particles: Particles, observer: Observer | None = None
) -> Room:
    """Return room for the samples of a scene; `engine_state` from `new_engine_state`."""
    return Room(
        particles,
        new_ledger(),
        engine_state,
        np.zeros(1, INITIAL),
        new_template(scene),
        np.empty((3, scene.particles)),
        np.empty((3, scene.particles)),
        np.zeros(1, outcome_type(scene.has_spins)),
        np.zeros(2, np.int64),
        np.zeros(len(CALLED), CALLEE),
        observer,
    )


def capacity_of(scene: Scene) -> int:
    """Return the maximum number of particles: where they break, twice the number of grains."""
    return (1 if scene.laws.fragmentation is None else 2) * scene.particles


def new_template(scene: Scene) -> NDArray[Any]:
    """Return the record of a grain before it is placed, shape (1,)."""
    return new_particles(scene._replace(particles=1), 1).records


def without_law(scene: Scene) -> Scene:
    """Return a scene that says whether grains differ in size, but not by which law.

    So one machine code serves all of them once the grains are placed.
    """
    return scene if scene.sizes is None else scene._replace(sizes=True)


def called_kernels(scene: Scene, room: Room) -> dict[str, tuple[Any, tuple[Any, ...]]]:
    """Return the kernels of a sample by name, each with arguments of the types it is called with.

    Parameters
    ----------
    scene
        Without its law of sizes.
    room
        Its room; the callees are not needed.
    """
    random, abort, end = np.random.default_rng(), np.zeros(1, np.uint8), scene.end_time
    sizes: Any = EqualSizes(2.0 * scene.radius)
    if scene.sizes is not None:
        sizes = DifferentSizes(np.full(1, scene.radius), scene.radius)
    laws, vectors = (scene.escape, scene.velocities), (room.placed, room.velocity)
    state = room.particles, room.ledger
    kernels = {
        PLACEMENT: (scatter, (*laws, random, sizes, scene.half_width, *vectors, abort)),
        ENGINE: (run_engine, (scene, *state, room.engine_state, room.initial, end, abort)),
        MEASUREMENT: (measure_sample, (scene, *state, room.initial, end, room.record)),
    }
    if room.observer is not None:
        counted = scene, room.particles, room.engine_state, room.observer, room.initial
        kernels[CENSUS] = take_census, (*counted, new_census_room(EXAMPLE_LAYOUT, 1), 0, 0)
    return kernels


_kept = threading.local()


def kept_engine_state(scene: Scene, capacity: int) -> Any:
    """Return the engine state of this thread's last sample, or a new one if that was not alike.

    To make it anew takes a tenth of the time of a sample: a system gives back large arrays at once.
    """
    key = type(scene.engine), scene.particles, capacity
    if getattr(_kept, "state_key", None) != key:
        _kept.state_key, _kept.state = key, new_engine_state(scene.engine, scene, capacity)
    return _kept.state


class PreparedScene(NamedTuple):
    """A scene as kernels take it, with what its room depends on.

    Attributes
    ----------
    scene
        Without its law of sizes.
    kind
        Number of grains, and the types of all parts: scenes of one kind share a room.
    template
        As in `Room`.
    """

    scene: Scene
    kind: tuple[int, Any]
    template: NDArray[Any]


MAX_PREPARED: Final = 256
"""Maximum number of scenes that a thread remembers, those of as many strings."""


def prepared_scene(scene: Scene) -> PreparedScene:
    """Return a scene as kernels take it; what is made of it is remembered."""
    known: dict[int, tuple[Scene, PreparedScene]] = _kept.__dict__.setdefault("scenes", {})
    before, prepared = known.get(id(scene), (None, None))
    if prepared is None or before is not scene:
        if len(known) >= MAX_PREPARED:
            known.clear()
        simple = without_law(scene)
        prepared = PreparedScene(simple, (scene.particles, _types_of(simple)), new_template(simple))
        known[id(scene)] = scene, prepared
    return prepared


MAX_KEPT: Final = 100_000
"""Maximum number of particles that there is room for in all rooms of a thread together: samples of
several experiments alternate. One room may be larger, and is then alone."""


@dataclass
class KeptRoom:
    """A room of a thread, with its number of particles, and those of its samples if it has some."""

    room: Room
    capacity: int
    particles: Particles | None = None


def kept_room(
    prepared: PreparedScene, particles: Particles | None = None, counts: bool = False
) -> Room:
    """Return the room of this thread's earlier samples for those of a scene, or a new one.

    Parameters
    ----------
    prepared
        The scene.
    particles
        Those to simulate with, which the caller keeps; by default those of the samples before.
    counts
        Whether censuses are taken.
    """
    scene, _, template = prepared
    kind, capacity = (prepared.kind, counts), capacity_of(scene)
    rooms: dict[Any, KeptRoom] = _kept.__dict__.setdefault("rooms", {})
    kept = rooms.pop(kind, None)
    if kept is None:
        while rooms and sum(each.capacity for each in rooms.values()) + capacity > MAX_KEPT:
            del rooms[next(iter(rooms))]
        kept = KeptRoom(_room_of(scene, counts), capacity)
    rooms[kind] = kept  # the last one
    if particles is None:
        if kept.particles is None:
            kept.particles = new_particles(scene, capacity)
        particles = kept.particles
    room = kept.room._replace(particles=particles)
    room.template[:] = template
    return room


def _room_of(scene: Scene, counts: bool) -> Room:
    """Return a new room for a scene, without particles; to make one takes as long as samples."""
    state, none = kept_engine_state(scene, capacity_of(scene)), new_particles(scene, 0)
    observer = new_observer(scene, capacity_of(scene)) if counts else None
    room = new_room(scene, state, none, observer)
    callees = np.zeros(len(CALLED), CALLEE)
    for name, (called, arguments) in called_kernels(scene, room).items():
        callees[CALLED.index(name)] = callee_of(called, arguments)
    return room._replace(callees=callees)


def _types_of(numbers: Any) -> Any:
    """Return the types of a NamedTuple and of all its parts."""
    if not isinstance(numbers, tuple):
        return type(numbers)
    return type(numbers), *map(_types_of, numbers)
