"""A point of a macroscopic flow that is a box of grains, stepped from outside  [B 9].

>>> from agglom_mpi import Box
>>> from agglom_mpi.config.campaign import Campaign
>>> scene = '''
... seed: 1
... scene:
...   particles: 200
...   half_width: 1 cm
...   velocities: {law: spread, mean: [0, 0, 0], transverse: 1}
...   restitution: {law: constant, value: 0.8}
...   heating: none
...   end_time: 1 s
... variables: {relative_speed: 1, size_ratio: 0.5, density: 2500}
... '''
>>> flow = [0.5, 0.0, 0.0]  # from the macroscopic model, m/s
>>> cloud = lambda random, n: random.normal(flow, 1.0, (n, 3))
>>> box = Box(Campaign.from_text(scene), velocities=cloud)
>>> before = box.state
>>> after = box.advance(0.02)
>>> after.granular_temperature < before.granular_temperature  # Haff's law
True
>>> lost = 1.5 * after.mass_density * (before.granular_temperature - after.granular_temperature)
>>> abs(after.dissipation_rate * 0.02 / lost - 1.0) < 1e-12
True
>>> box.set(velocities=box.particles.velocities + [0.1, 0.0, 0.0])  # the mean flow changed
>>> faster = box.advance(0.02)
>>> change = (faster.momentum_density - before.momentum_density) / faster.mass_density
>>> bool(abs(change - [0.1, 0.0, 0.0]).max() < 1e-12)
True
>>> box.reset().time
0.0
"""

import os
from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from agglom_mpi.config.arguments import count_argument
from agglom_mpi.config.campaign import Campaign
from agglom_mpi.config.loading import load_campaign
from agglom_mpi.config.yaml_source import ArgumentError
from agglom_mpi.coupling.inputs import initial_particles, read_values
from agglom_mpi.coupling.state import BoxParticles, State, homogenise, particles_of
from agglom_mpi.formatting import format_duration, pluralise
from agglom_mpi.public_face import PublicFace
from agglom_mpi.simulation.particles import EXHAUSTED, new_ledger
from agglom_mpi.simulation.scene import new_engine_state
from agglom_mpi.simulation.stepwise import (
    OBSERVATION,
    advance_run,
    empty_observer,
    room_for_particles,
    start_run,
)
from agglom_mpi.verbs.simulate import random_numbers

if TYPE_CHECKING:
    from agglom_mpi.simulation.engines import Engine

Input = float | npt.ArrayLike | Callable[[np.random.Generator, int], npt.ArrayLike] | Any
"""One value for all, an array, a function of (random, count), or a distribution with `rvs`."""


class Box(metaclass=PublicFace, constructor=True):
    """A box of grains in the scene of a campaign, stepped by a macroscopic model.

    The scene's engine runs it exactly as a sample. The number of steps in which a time is run
    through does not change a bit of the result, nor does reading the state. Two boxes of one scene,
    string and sample number are the same. `copy.deepcopy` and `pickle` make another that continues
    the same, to try a step or to move it to another process.

    Time steps of the engines `fixed` (their length is the scene's end time over their number) and
    `adaptive` continue across those of the macroscopic model: at a time between two of them
    particles are where straight flight takes them.

    Parameters
    ----------
    campaign : Campaign, str or path
        A campaign, or the path of its file. Its scene, variables and seed are used; its end time
        is no limit. One with laws of one's own is `load_campaign(path, allow_code=True)`; a pickle
        of the box carries their modules.
    parameters : dict, optional
        Values of variables by name, SI numbers or texts with units, as for `campaign.simulate`.
        A variable that is not given has the middle of its searched range.
    radii : input, shape (n,), m, optional
        By default those of the grains of the scene. All have the scene's density.
    velocities : input, shape (n, 3) or (3,), m/s, optional
        By default drawn by the scene's law.
    temperatures : input, shape (n,), K, optional
        By default the scene's.
    positions : input, shape (n, 3), m, optional
        From −D to D in each direction; by default placed at random without overlap.
    grains : array of int, shape (n,), optional
        Number of grains in each particle, where aggregates break; by default 1.
    particles : int, optional
        Number n, if no array other than the temperatures gives it; by default that of the scene.
    sample : int, optional
        Number of the random start: whatever is not given equals that of
        `campaign.simulate(parameters, sample)`.
    engine : str, optional
        Another engine than the scene's: `event`, `fixed`, `fixed:STEPS` or `adaptive`.

    Notes
    -----
    An input is one value for all particles, an array, a function of (random, n) that returns one of
    these, with a numpy Generator, or a distribution with `rvs(size=..., random_state=...)`, such as
    the frozen ones of scipy.stats, which draws each component.

    Raises
    ------
    ValueError
        If an input is not possible; names it, its value and what is allowed. A CampaignError is a
        ValueError.

    Examples
    --------
    >>> import agglom_mpi
    >>> box = agglom_mpi.Box("jobs/quickstart.yaml", {"hardness": "67 MPa"}, temperatures=330.0)
    >>> state = box.advance(1e-4)  # s
    >>> state.granular_temperature > 0.0, state.dissipation_rate > 0.0  # (m/s)², W/m³
    (True, True)
    >>> box.set(velocities=box.particles.velocities + [0.1, 0.0, 0.0])  # the mean flow changed
    >>> box.reset().time
    0.0
    """

    def __init__(
        self,
        campaign: Campaign | str | os.PathLike[str],
        parameters: Mapping[str, float | str] | None = None,
        *,
        radii: Input = None,
        velocities: Input = None,
        temperatures: Input = None,
        positions: Input = None,
        grains: npt.ArrayLike | None = None,
        particles: int | None = None,
        sample: int = 0,
        engine: "str | Engine | None" = None,
    ) -> None:
        if not isinstance(campaign, Campaign):
            campaign = load_campaign(campaign)
        self._name = campaign.name
        string = campaign.parameters(parameters)
        sample = count_argument(campaign.name, "sample", sample)
        campaign.check_scales(string)
        scene = campaign.at(string).build(campaign.engine(engine))
        friction: Any = scene.laws.friction
        if scene.has_spins and friction.spin_temperature > 0.0:
            message = "is given; must be left out, as a box starts without spins"
            raise ArgumentError.of(campaign.name, "scene.friction.spin_temperature", message)
        if campaign.scene.escape.is_sheared():
            message = "is 'shear', whose images move on while a step starts anew; must be another"
            raise ArgumentError.of(campaign.name, "scene.escape", message)
        self._random = random_numbers(campaign, string, sample)
        self._initial = initial_particles(
            scene, self._random, particles, radii, velocities, temperatures, positions, grains
        )
        self._random_state = self._random.bit_generator.state
        total = int(self._initial.grains.sum())
        self._scene = scene._replace(particles=total, sizes=None)
        breaks = scene.laws.fragmentation is not None
        self._capacity = 2 * total if breaks else len(self._initial.radii)
        self._volume = (2.0 * scene.half_width) ** 3
        self._elapsed, self._start_time = 0.0, 0.0  # s since `start_run`, and until then
        self._engine_state: Any = None
        self._observation = np.zeros(1, OBSERVATION)
        self._abort = np.zeros(1, np.uint8)
        self.reset()

    def __repr__(self) -> str:
        particles = pluralise(self.state.particles, "particle")
        return f"<Box of {self._name!r}: {particles} at {format_duration(self.time)}>"

    @property
    def state(self) -> State:
        """The homogenised state, with the rates of the last step."""
        return self._state

    @property
    def time(self) -> float:
        """Time in s since the box was made or reset."""
        return self._state.time

    @property
    def volume(self) -> float:
        """Volume in m³."""
        return self._volume

    @property
    def particles(self) -> BoxParticles:
        """Copies of the particles at the present time."""
        return particles_of(self._observer.copy)

    def advance(self, dt: float) -> State:
        """Advance the box by a macroscopic time step.

        Parameters
        ----------
        dt
            Length of the step, s.

        Returns
        -------
        State
            At the end of the step.

        Raises
        ------
        ValueError
            If `dt` is not finite and greater than 0.
        RuntimeError
            If the budget of the engine did not suffice, or a quantity is not finite any more. The
            state is then that of the time reached.
        """
        until = self._elapsed + _seconds(dt)
        if not until > self._elapsed:
            raise ValueError(f"dt is {dt:g} s; must not be lost in rounding at {self.time:g} s")
        ledger, pending = new_ledger(), float(self._observation["pending"][0])
        arguments = self._particles, self._engine_state, self._observer, ledger, until, self._abort
        advance_run(self._scene, *arguments, self._observation)
        reached = float(self._observation["reached"][0])
        step, self._elapsed = reached - self._elapsed, reached
        time = self._start_time + reached
        self._state = homogenise(
            self._scene, self._observation[0], ledger, pending, self._volume, time, step
        )
        if ledger.counts[EXHAUSTED]:
            raise RuntimeError(f"the engine's budget was used up at {time:g} s")
        if not self._observation["finite"][0]:
            raise RuntimeError(f"something is not finite any more at {time:g} s")
        return self._state

    def set(self, *, velocities: Input = None, temperatures: Input = None) -> None:
        """Set velocities or temperatures of the particles; inputs as for the constructor.

        Arrays are in the order of `particles`. The time goes on; rates begin at 0 again, and so do
        the steps of a time-stepping engine.
        """
        rows = self.particles
        count = len(rows.radii)
        if velocities is not None:
            rows = rows._replace(
                velocities=read_values("velocities", velocities, self._random, count)
            )
        if temperatures is not None:
            rows = rows._replace(
                temperatures=read_values("temperatures", temperatures, self._random, count)
            )
        last_impacts = self._observer.copy.last_impact
        since = None if last_impacts is None else last_impacts[:count] - self._elapsed
        spins = self._observer.copy.spin
        spins = None if spins is None else spins[:, :count].copy()
        self._start(rows, since, int(self._particles.labels_given[0]), self.time, spins)

    def reset(self) -> State:
        """Return to the initial particles at the time 0; returns that state.

        What `set` draws from distributions is drawn again the same.
        """
        self._random.bit_generator.state = self._random_state
        self._start(self._initial, None, len(self._initial.radii), 0.0)
        return self._state

    def _start(
        self,
        rows: BoxParticles,
        last_impacts: Any,
        labels_given: int,
        time: float,
        spins: Any = None,
    ) -> None:
        particles: Any = room_for_particles(self._scene, self._capacity)
        count = len(rows.radii)
        particles.size[0] = count
        particles.position[:, :count] = rows.positions.T
        particles.velocity[:, :count] = rows.velocities.T
        particles.radius[:count] = rows.radii
        particles.mass[:count] = rows.masses
        particles.temperature[:count] = rows.temperatures
        if last_impacts is not None:
            particles.last_impact[:count] = last_impacts
        if spins is not None:
            particles.spin[:, :count] = spins
        particles.grains[:count] = rows.grains
        particles.label[:count] = rows.labels
        particles.labels_given[0] = labels_given
        self._observer = empty_observer(self._scene, self._capacity)
        self._particles, self._start_time, self._elapsed = particles, time, 0.0
        self._engine_state = new_engine_state(self._scene.engine, self._scene, self._capacity)
        arguments = particles, self._engine_state, self._observer, self._observation
        start_run(self._scene, *arguments)
        self._state = homogenise(
            self._scene, self._observation[0], new_ledger(), 0.0, self._volume, time, 0.0
        )


def _seconds(dt: float) -> float:
    if isinstance(dt, bool) or not isinstance(dt, int | float | np.integer | np.floating):
        raise ValueError(f"dt is {dt!r}; must be a time in s greater than 0")
    if not (np.isfinite(dt) and dt > 0.0):
        raise ValueError(f"dt is {dt:g} s; must be finite and greater than 0")
    return float(dt)
