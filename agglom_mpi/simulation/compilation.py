"""Compilation of the kernels of a kind of scene, ahead of its samples and by two processes at once.

A kind is the types of a scene's submodels. The engine takes most of the time of a compilation, so
one process compiles it, and another meanwhile everything else: first the kernels that the engine
calls, which are in the cache by the time that the first process comes to them.
"""

import hashlib
import logging
import os
import pickle
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, nullcontext, suppress
from pathlib import Path
from typing import Any, Final

import numpy as np

from agglom_mpi.compilation.kernels import cache_folder, code_key, compile_ahead, runs_compiled
from agglom_mpi.compilation.stages import law_of, laws_in, module_key
from agglom_mpi.formatting import pluralise
from agglom_mpi.launcher import python_command
from agglom_mpi.physics.pair import ContactPair
from agglom_mpi.simulation import census, initial_state, sample_kernels, sample_range, trajectory
from agglom_mpi.simulation.census import EXAMPLE_LAYOUT
from agglom_mpi.simulation.collision_counts import new_collision_counts
from agglom_mpi.simulation.event_driven.prefetching import new_winners
from agglom_mpi.simulation.event_driven.state import rebuild
from agglom_mpi.simulation.impact import solve_impact
from agglom_mpi.simulation.own_laws import check_own_laws
from agglom_mpi.simulation.particles import new_particles
from agglom_mpi.simulation.sample_draws import new_draws
from agglom_mpi.simulation.sample_range import new_results, new_watch, simulate_range
from agglom_mpi.simulation.sample_room import (
    CENSUS,
    ENGINE,
    MEASUREMENT,
    PLACEMENT,
    called_kernels,
    new_room,
    without_law,
)
from agglom_mpi.simulation.scene import Scene, new_engine_state
from agglom_mpi.simulation.stream_states import STATE_WORDS, fill_states

RANGE: Final = "sequence"
FRAMES: Final = "frames"
COUNTED_RANGE: Final = "sequence with censuses"
"""Kernels of a scene; `RANGE` calls the first three for one sample after another, `FRAMES` is for
frames at set times."""

COUNTING_ENGINE: Final = "engine that counts collisions"
"""Kernel of the engine for `CollisionCounts`."""

STREAMS: Final = "streams"
"""Kernel that seeds random generators, one for all scenes."""

CONTACT: Final = "contact"
CELLS: Final = "cells"
"""Kernels that the engine calls; `CELLS` only the event engine."""

_ALL: Final = "without frames"

LOG: Final = logging.getLogger(__name__)
"""Receives lines on what is being compiled where no function is given for them.

Commands print them; a program that imports the package sees them with
`logging.basicConfig(level=logging.INFO)`.
"""


def kind_of(scene: Scene) -> str:
    """Return the names of the types that kernels of a scene are compiled for, as text.

    Whether memory is prefetched is a matter of types, too.
    """
    parts = [*scene[:2], *scene.laws, scene.cooling, scene.engine]
    parts += [] if scene.sizes is None else [True]
    parts += [inner for part in parts if isinstance(part, tuple) for inner in laws_in(part)]
    names = [f"{module_key(type(part).__module__)}.{type(part).__name__}" for part in parts]
    prefetches = law_of(scene.engine).uses_linked_cells and new_winners(scene.particles) is not None
    return " ".join([*names, "prefetching"] if prefetches else names)


def is_compiled(scene: Scene, frames: bool = False, counts: bool = False) -> bool:
    """Return whether the kernels of a kind of scene were compiled before on this kind of machine.

    With `frames` that of frames at set times, with `counts` those of censuses, too.
    """
    kinds = [_ALL, *_further(frames, counts)]
    return not runs_compiled() or all(mark_of(scene, what).exists() for what in kinds)


def _further(frames: bool, counts: bool) -> list[str]:
    """Return the names of the kernels that not every sample needs."""
    return [*([FRAMES] if frames else []), *([CENSUS, COUNTED_RANGE] if counts else [])]


def compile_kernels(
    scene: Scene,
    frames: bool = False,
    show: Callable[[str], None] = LOG.info,
    counts: bool = False,
) -> float:
    """Compile the kernels of a kind of scene, or load them from the cache.

    Parameters
    ----------
    scene
        A scene of the kind.
    frames
        Whether frames at set times will be taken.
    show
        Called with a line on what is being compiled, where there is something; by default it goes
        to `LOG`.
    counts
        Whether censuses of samples will be taken.

    Returns
    -------
    float
        Seconds that compilation took, 0 where all is in the cache.
    """
    if not runs_compiled():
        return 0.0
    begin, together, compiled = time.perf_counter(), not is_compiled(scene), False
    further = _further(frames, counts)
    names = [PLACEMENT, MEASUREMENT, RANGE, ENGINE, *further]
    is_new = dict.fromkeys(names, together)
    is_new |= {name: together or not mark_of(scene, name).exists() for name in further}
    if new := [name for name in names if is_new[name]]:
        show(f"compiling {pluralise(len(new), 'kernel')} of a new kind of scene: {', '.join(new)}")
    with engine_compiled_elsewhere(scene) if together else nullcontext(_nothing) as finish:
        cells = [CELLS] if law_of(scene.engine).uses_linked_cells else []
        for name in [CONTACT, *cells, *names, STREAMS]:
            if name == ENGINE:
                finish()
            compiled |= _compile(name, scene)
            if is_new.get(name):
                show(f"{name} compiled, {time.perf_counter() - begin:.0f} s")
    for what in [_ALL, *further]:
        with suppress(OSError):  # a cache that is full may be read-only
            mark_of(scene, what).touch()
    # What was compiled before may be missing from the cache, or be damaged.
    return time.perf_counter() - begin if new or compiled else 0.0


def _compile(name: str, scene: Scene) -> bool:
    """Compile or load a kernel of a scene; return whether it was compiled."""
    try:
        return compile_ahead(*_example(name, scene))
    except Exception:  # Numba raises many kinds
        check_own_laws(scene)
        raise


def ensure_compiled(scene: Scene, frames: bool = False, counts: bool = False) -> None:
    """Compile the kernels of a kind of scene where they are not in the cache, and log it."""
    kind = kind_of(scene), frames, counts
    if kind not in READY:
        if not is_compiled(scene, frames, counts):
            compile_kernels(scene, frames, counts=counts)
        READY.add(kind)


READY: Final[set[tuple[str, bool, bool]]] = set()
"""Kinds of scenes, whether with frames and with censuses, that this process has found compiled."""


def ensure_counting_compiled(scene: Scene) -> None:
    """Compile the engine that counts collisions where it is not in the cache, and log it."""
    mark = mark_of(scene, COUNTING_ENGINE)
    if runs_compiled() and not mark.exists():
        LOG.info("compiling 1 kernel of a new kind of scene: %s", COUNTING_ENGINE)
        _compile(COUNTING_ENGINE, scene)
        with suppress(OSError):
            mark.touch()


def _example(name: str, scene: Scene) -> tuple[Any, tuple[Any, ...]]:
    """Return a kernel and arguments of the types that it is called with."""
    if name == STREAMS:
        words, states = np.zeros(3, np.uint64), np.zeros((1, STATE_WORDS), np.uint64)
        return fill_states, (words, np.uint64(0), states)
    count, scene = scene.particles, without_law(scene._replace(particles=1))
    state = new_engine_state(scene.engine, scene, 1)
    observer = trajectory.new_observer(scene, 1) if name in (CENSUS, COUNTED_RANGE) else None
    room = new_room(scene, state, new_particles(scene, 1), observer)
    if law_of(scene.engine).uses_linked_cells:
        room = room._replace(engine_state=room.engine_state._replace(winners=new_winners(count)))
    if name == CONTACT:
        return solve_impact, (scene.laws, ContactPair(*[1.0] * len(ContactPair._fields)))
    if name == CELLS:
        return rebuild, (scene, room.particles, room.engine_state, 0.0)
    if name == FRAMES:
        observer = trajectory.new_observer(scene, 1)
        shown = scene, room.particles, room.engine_state, observer, scene.end_time
        return trajectory.observe_particles, shown
    if name in (RANGE, COUNTED_RANGE):
        watch = new_watch(np.zeros(1, np.uint8))
        random = np.random.default_rng()
        results = new_results(1, EXAMPLE_LAYOUT if name == COUNTED_RANGE else None, scene.has_spins)
        return simulate_range, (scene, room, random, new_draws(), watch, results)
    if name == COUNTING_ENGINE:
        counts = new_collision_counts(scene.mass, 1.0, 1, np.ones(1))
        room = room._replace(ledger=room.ledger._replace(collisions=counts))
        name = ENGINE
    return called_kernels(scene, room)[name]


def _nothing() -> None:
    pass


CHILD_PROGRAM: Final = """
import pickle
sys.path[:] = [*pickle.load(sys.stdin.buffer), sys.path[-1]]
from agglom_mpi.simulation.compilation import compile_for_parent
compile_for_parent()
"""


@contextmanager
def engine_compiled_elsewhere(scene: Scene) -> Iterator[Callable[[], object]]:
    """Let another process compile the engine; gives a function that waits for its end.

    Where there is one core, or no room for another process, the function does nothing, and the
    engine is compiled here.
    """
    process = None
    if len(os.sched_getaffinity(0)) > 1:
        with suppress(OSError):  # what it was to compile is compiled here
            process = subprocess.Popen(
                python_command(CHILD_PROGRAM),
                env=os.environ | {"NUMBA_CACHE_DIR": str(cache_folder().parent)},
                stdin=subprocess.PIPE,
                stdout=subprocess.DEVNULL,
                stderr=subprocess.DEVNULL,
            )
            assert process.stdin is not None
            # An interactive Python looks into the current folder first; the child must not.
            path = [each for each in sys.path if each]
            process.stdin.write(pickle.dumps(path) + pickle.dumps(scene))
            process.stdin.flush()
    try:
        yield process.wait if process is not None else _nothing
    finally:
        if process is not None:
            process.kill()
            process.wait()
            assert process.stdin is not None
            with suppress(OSError):  # it may have ended before it had read all
                process.stdin.close()


def compile_for_parent() -> None:
    """Compile the engine of the scene on standard input, and `STREAMS`; see above.

    It ends when its parent does, however that ends: standard input is closed then.
    """
    scene = pickle.load(sys.stdin.buffer)

    def watch() -> None:
        sys.stdin.buffer.read()
        os._exit(1)

    threading.Thread(target=watch, daemon=True).start()
    for name in (ENGINE, STREAMS):
        compile_ahead(*_example(name, scene))
    os._exit(0)


def mark_of(scene: Scene, what: str) -> Path:
    """Return the file that says that kernels of a kind of scene were compiled."""
    sources = [
        Path(str(module.__file__))
        for module in (census, initial_state, sample_kernels, sample_range, trajectory)
    ]
    text = f"{code_key(sources)} {kind_of(scene)} {what}"
    return cache_folder() / f"{hashlib.sha256(text.encode()).hexdigest()}.compiled"
