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

from agglom_mpi.config.campaign import Campaign, load_campaign
from agglom_mpi.coupling.given import check_temperatures, read
from agglom_mpi.coupling.start import start
from agglom_mpi.coupling.state import BoxParticles, State, homogenise, particles_of
from agglom_mpi.random_streams import sample_stream
from agglom_mpi.simulation.particles import EXHAUSTED
from agglom_mpi.simulation.stepwise import (
    OBSERVATION,
    advance_run,
    empty_ledger,
    empty_particles,
    new_observer,
    start_run,
)

if TYPE_CHECKING:
    from agglom_mpi.config.scene import Engine

Given = float | npt.ArrayLike | Callable[[np.random.Generator, int], npt.ArrayLike] | Any
"""One value for all, an array, a function of (random, count), or a distribution with `rvs`."""


class Box:
    """A box of grains in the scene of a campaign, run for as long as a macroscopic model says.

    It is run by the scene's engine, exactly as a sample is. In how many steps a time is run through
    does not change a bit of what comes out, nor does looking. Two boxes of one scene, string and
    sample number are the same. `copy.deepcopy` and `pickle` make another that goes on the same, to
    try a step or to move it to another process.

    Time steps of the engines `fixed` (their length is the scene's end time over their number) and
    `adaptive` go on across those of the macroscopic model: at a time between two of them particles
    are where they fly straight on.

    Parameters
    ----------
    campaign
        A campaign, or the path of its file; only its scene, variables and seed matter. Its end time
        is no limit.
    parameters
        Values of variables by name, SI numbers or texts with units, as for `campaign.simulate`;
        the middle of a searched range if not given.
    radii
        m, shape (n,); that of the grains of the scene if not given. All have the scene's density.
    velocities
        m/s, shape (n, 3) or (3,); drawn by the scene's law if not given.
    temperatures
        K, shape (n,); the scene's if not given.
    positions
        m, shape (n, 3), −D to D; placed at random without overlap if not given.
    grains
        How many grains each particle is made of, shape (n,), where aggregates break; 1 if not
        given.
    particles
        How many, n, where no array says it; as many as in the scene if not given.
    sample
        Which random start; by it and the campaign's seed, what is not given is that of
        `campaign.simulate(parameters, sample)`.
    engine
        Another engine than the scene's: `event`, `fixed`, `fixed:STEPS` or `adaptive`.

    What is given may be one value for all, an array, a function of (random, n) that returns one,
    with a numpy Generator, or a distribution with `rvs(size=..., random_state=...)`, such as the
    frozen ones of scipy.stats, which draws each component.

    Raises
    ------
    ValueError
        If something given cannot be; which value it is and what is allowed. A CampaignError is one.
    """

    def __init__(
        self,
        campaign: Campaign | str | os.PathLike[str],
        parameters: Mapping[str, float | str] | None = None,
        *,
        radii: Given = None,
        velocities: Given = None,
        temperatures: Given = None,
        positions: Given = None,
        grains: npt.ArrayLike | None = None,
        particles: int | None = None,
        sample: int = 0,
        engine: "str | Engine | None" = None,
    ) -> None:
        if not isinstance(campaign, Campaign):
            campaign = load_campaign(campaign)
        string = campaign.parameters(parameters)
        campaign.check_scales(string)
        scene = campaign.scene.build(string, campaign.engine(engine))
        self._random = sample_stream(campaign.seed, string, sample, campaign.common_configurations)
        self._given = start(
            scene, self._random, particles, radii, velocities, temperatures, positions, grains
        )
        self._drawn = self._random.bit_generator.state
        total = int(self._given.grains.sum())
        self._scene = scene._replace(particles=total)
        breaks = scene.laws.fragmentation is not None
        self._capacity = 2 * total if breaks else len(self._given.radii)
        self._volume = (2.0 * scene.half_width) ** 3
        self._elapsed, self._begun = 0.0, 0.0  # s since `start_run`, and until then
        self._kept: Any = None  # by the engine
        self._seen = np.zeros(1, OBSERVATION)
        self._abort = np.zeros(1, np.uint8)
        self.reset()

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
        """The particles as they are now."""
        return particles_of(self._looker.copy)

    def advance(self, dt: float) -> State:
        """Run the box for a macroscopic time step.

        Parameters
        ----------
        dt
            s.

        Returns
        -------
        State
            At the end of the step.

        Raises
        ------
        ValueError
            If `dt` is no positive time.
        RuntimeError
            If the budget of the engine did not suffice, or something is not finite any more. The
            state is that of the time reached then.
        """
        until = self._elapsed + _seconds(dt)
        if not until > self._elapsed:
            raise ValueError(f"dt is {dt:g} s; must not be lost in rounding at {self.time:g} s")
        ledger, pending = empty_ledger(), float(self._seen["pending"][0])
        arguments = self._particles, self._kept, self._looker, ledger, until, self._abort
        advance_run(self._scene, *arguments, self._seen)
        reached = float(self._seen["reached"][0])
        step, self._elapsed = reached - self._elapsed, reached
        time = self._begun + reached
        self._state = homogenise(self._seen[0], ledger, pending, self._volume, time, step)
        if ledger.tally[EXHAUSTED]:
            raise RuntimeError(f"the engine's budget was used up at {time:g} s")
        if not self._seen["finite"][0]:
            raise RuntimeError(f"something is not finite any more at {time:g} s")
        return self._state

    def set(self, *, velocities: Given = None, temperatures: Given = None) -> None:
        """Give the particles other velocities or temperatures, as the constructor takes them.

        Arrays are in the order of `particles`, which others keep. The time goes on; rates begin
        at 0 again, and so do the steps of a time-stepping engine.
        """
        rows = self.particles
        count = len(rows.radii)
        if velocities is not None:
            rows = rows._replace(velocities=read("velocities", velocities, self._random, count))
        if temperatures is not None:
            values = read("temperatures", temperatures, self._random, count)
            check_temperatures(values)
            rows = rows._replace(temperatures=values)
        struck = self._looker.copy.last_impact
        since = None if struck is None else struck[:count] - self._elapsed
        self._set_out(rows, since, int(self._particles.labels_given[0]), self.time)

    def reset(self) -> State:
        """Return to what was given at first, at the time 0; that state.

        What `set` draws from distributions is drawn again the same.
        """
        self._random.bit_generator.state = self._drawn
        self._set_out(self._given, None, len(self._given.radii), 0.0)
        return self._state

    def _set_out(self, rows: BoxParticles, struck: Any, labels_given: int, time: float) -> None:
        particles: Any = empty_particles(self._scene, self._capacity)
        count = len(rows.radii)
        particles.size[0] = count
        particles.position[:, :count] = rows.positions.T
        particles.velocity[:, :count] = rows.velocities.T
        for array, values in zip(particles[3:6], rows[2:5], strict=True):
            array[:count] = values
        if struck is not None:
            particles.last_impact[:count] = struck
        particles.grains[:count] = rows.grains
        particles.label[:count] = rows.labels
        particles.labels_given[0] = labels_given
        self._looker = new_observer(self._scene, self._capacity)
        self._particles, self._begun, self._elapsed = particles, time, 0.0
        self._kept = start_run(self._scene, particles, self._looker, self._seen)
        self._state = homogenise(self._seen[0], empty_ledger(), 0.0, self._volume, time, 0.0)


def _seconds(dt: float) -> float:
    if isinstance(dt, bool) or not isinstance(dt, int | float | np.integer | np.floating):
        raise ValueError(f"dt is {dt!r}; must be a time in s greater than 0")
    if not (np.isfinite(dt) and dt > 0.0):
        raise ValueError(f"dt is {dt:g} s; must be finite and greater than 0")
    return float(dt)
