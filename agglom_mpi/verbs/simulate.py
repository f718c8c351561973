"""Simulation of one sample of a campaign, or of all its experiments, as a rank simulates it."""

import math
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

import agglom_mpi.simulation.event_driven.engine
import agglom_mpi.simulation.time_driven.steppers  # noqa: F401  (all register their engines)
from agglom_mpi.config.campaign import Campaign
from agglom_mpi.config.given_strings import read_string
from agglom_mpi.config.user_function import (
    evaluate,
    evaluate_quantities,
    function_of_means,
    objective_alone,
)
from agglom_mpi.config.yaml_source import CampaignError, Problem
from agglom_mpi.errors import named_error
from agglom_mpi.measurements.layout import CensusLayout, prefix_of
from agglom_mpi.outcome import (
    COMPLETED,
    LEDGER,
    OUTCOME,
    REASONS,
    FinalParticles,
    final_particles,
    joined,
)
from agglom_mpi.physics import scales
from agglom_mpi.random_streams import sample_key, sample_stream
from agglom_mpi.simulation.census import census_values, new_census_room
from agglom_mpi.simulation.compilation import ensure_compiled
from agglom_mpi.simulation.engines import Engine
from agglom_mpi.simulation.finished import finished_sample
from agglom_mpi.simulation.frames import frame_times, new_frames, without_temperatures
from agglom_mpi.simulation.measurement import shear_account
from agglom_mpi.simulation.particles import new_ledger
from agglom_mpi.simulation.sample import (
    Outcome,
    count_changes,
    initial_radii,
    simulate_counted,
    simulate_scene,
)
from agglom_mpi.simulation.scene import Scene
from agglom_mpi.simulation.spins import spin_account
from agglom_mpi.stopwatch import Stopwatch


def simulate(
    campaign: Campaign,
    parameters: Mapping[str, float | str] | npt.ArrayLike,
    sample: int = 0,
    engine: str | Engine | None = None,
    frames: int | Sequence[float] | npt.NDArray[np.float64] | None = None,
) -> Outcome:
    """Simulate one sample exactly as a rank does; see `RunnableCampaign.simulate`."""
    campaign.require_one_scene("simulate")
    vector = read_string(campaign, parameters)
    sample = campaign.count("sample", sample)
    campaign.check_scales(vector)
    times = None if frames is None else _frame_times(campaign, frames, vector)
    scene = campaign.at(vector).build(campaign.engine(engine))
    room = None if times is None else new_frames(times, scene.particles, scene.has_spins)
    random = random_numbers(campaign, vector, sample)
    layout = campaign.census
    census = new_census_room(layout, 1) if isinstance(layout, CensusLayout) else None
    ensure_compiled(scene, room is not None, census is not None)
    stopwatch, ledger = Stopwatch(), new_ledger()
    if census is None or room is not None:
        record, particles = simulate_scene(scene, random, frames=room, ledger=ledger)
    else:
        record, particles = simulate_counted(scene, random, census, ledger=ledger)
    spent = stopwatch.read()
    if census is not None and room is not None:  # one kernel counts, another records frames
        simulate_counted(scene, random_numbers(campaign, vector, sample), census)
    if record["state"] != COMPLETED:
        raise RuntimeError(f"sample {sample} failed: {REASONS[record['reason']]}")
    ratio = float(record["mean_radius_ratio"])
    final = final_particles(scene, particles)
    try:
        values = objective_value(campaign, vector, sample, (scene, record, final))
    except Exception as error:  # a user's function may raise any
        reason = named_error(error)
        raise RuntimeError(f"sample {sample} failed: {reason}") from error
    if not scene.has_temperature:
        final = without_temperatures(final)
        room = None if room is None else without_temperatures(room)
    return Outcome(
        mean_radius_ratio=ratio,
        objective=values.pop("objective"),
        quantities=values,
        particles=int(record["particles"]),
        radii=final.radii / scene.radius,
        temperatures=final.temperatures,
        moments=np.array([ratio, *(float(record[f"radius_moment_{r}"]) for r in (2, 3, 4))]),
        ledger={name: record[name].item() for name in LEDGER}
        | spin_account(record)
        | shear_account(scene, particles, ledger),
        collisions=int(record["collisions"]),
        merges=int(record["merges"]),
        breakups=int(record["breakups"]),
        steps=int(record["steps"]),
        seconds=spent.wall,
        cpu_seconds=spent.cpu,
        record=record,
        final=final,
        frames=room,
        census=None
        if census is None
        else tuple(each[0] for each in census_values(census).values()),
    )


def _frame_times(
    campaign: Campaign, frames: Any, string: npt.NDArray[np.float64]
) -> npt.NDArray[np.float64]:
    try:
        return frame_times(frames, scales.end_time(*campaign.at(string)))
    except ValueError as error:
        raise CampaignError(Problem(campaign.name, None, "frames", str(error))) from None


def try_function(campaign: Campaign) -> Outcome | None:
    """Call the function of a campaign's objective with one sample from the middle of the box.

    Returns
    -------
    Outcome or None
        Of the sample; None if the objective is no function.

    Raises
    ------
    CampaignError
        If it raises, or returns something else than a finite float, or the quantities that are
        named, or another value when it is called again; or the sample fails.
    """
    function = campaign.user_function
    if function is None:
        return None
    try:
        first, second = (simulate(campaign, campaign.parameters()) for _ in range(2))
        values = [repr((each.objective, each.quantities)) for each in (first, second)]
        if values[0] != values[1]:
            raise RuntimeError(f"returns {first.objective!r} and then {second.objective!r}")
        return first
    except RuntimeError as error:
        message = f"is {function.call!r}, but of the middle of the box {error}"
        raise campaign.function_error(message) from error


def changes_until(
    campaign: Campaign,
    parameters: npt.ArrayLike,
    sample: int,
    share: float,
    engine: Any = None,
) -> int:
    """Return the number of merges and breakups of a sample until a share of its end time.

    Arguments as for `simulate`. A sample that finds no place for its grains has none.
    """
    vector = np.asarray(parameters, dtype=np.float64)
    scene = campaign.at(vector).build(engine)
    random = random_numbers(campaign, vector, sample)
    ensure_compiled(scene)
    return count_changes(scene, random, share * scene.end_time)


def random_numbers(
    campaign: Campaign, parameters: npt.NDArray[np.float64], sample: int
) -> np.random.Generator:
    """Return the random numbers of a sample of a string, (k,), from their beginning."""
    numbers = campaign.variables.stream_key(parameters)
    common = campaign.common_configurations
    return sample_stream(campaign.seed, numbers, sample, common, campaign.volume)


def stream_key(campaign: Campaign, parameters: npt.NDArray[np.float64]) -> tuple[int, ...]:
    """Return the key of the random numbers of a string, (k,), which a sample's number ends."""
    numbers = campaign.variables.stream_key(parameters)
    return sample_key(campaign.seed, numbers, campaign.common_configurations, campaign.volume)


def objective_value(
    campaign: Campaign,
    parameters: npt.NDArray[np.float64],
    sample: int,
    completed: tuple[Scene, Any, FinalParticles],
) -> dict[str, float]:
    """Return the objective of one completed sample alone, and the quantities of its function.

    Parameters
    ----------
    campaign
    parameters
        The string, shape (k,).
    sample
        Number of the sample in its random streams.
    completed
        Its scene, its `OUTCOME` and its particles.

    Returns
    -------
    dict
        `objective`, nan if it is not defined for a sample alone; and the quantities by name in SI
        units. All are nan if the function cannot be called here.

    Raises
    ------
    Exception
        As from `user_function.evaluate` and `user_function.evaluate_quantities`.
    """
    function, objective = campaign.user_function, campaign.objective
    scene, record, final = completed
    if objective.code is None:
        samples = np.array([record])
        return {"objective": float(campaign.objective_at(parameters).of_samples(samples)[0])}
    if function is None or not function.module.source:
        return dict.fromkeys(("objective", *objective.quantity_units), math.nan)
    initial = initial_radii(scene, lambda: random_numbers(campaign, parameters, sample))
    values = campaign.variables.used_values(parameters)
    seen = finished_sample(scene, values, record, final, initial)
    of_means = function_of_means(function, objective.code_of_means)
    if of_means is None:
        return {"objective": evaluate(function, seen)}
    quantities = evaluate_quantities(function, seen, objective.quantity_units)
    return {"objective": objective_alone(of_means, quantities), **quantities}


class ExperimentScene(NamedTuple):
    """Campaign, string and scene of the samples of a string in one experiment.

    Attributes
    ----------
    prefix
        What the names of its columns begin with.
    campaign
        The experiment as a campaign of its own.
    string
        Its own string, shape (k,).
    scene, layout
        Scene of the string, and layout of its censuses.
    """

    prefix: str
    campaign: Campaign
    string: npt.NDArray[np.float64]
    scene: Scene
    layout: CensusLayout


def experiment_scenes(
    campaign: Campaign, parameters: npt.NDArray[np.float64], engine: Engine | None = None
) -> tuple[ExperimentScene, ...]:
    """Return the scenes of a string, (k,), in the order of the experiments.

    Raises
    ------
    ValueError
        If a law refuses the string.
    """
    found = []
    for each in campaign.experiments:
        own, layout = each.own(parameters), each.campaign.census
        assert isinstance(layout, CensusLayout)
        scene = each.campaign.at(own).build(engine)
        found.append(ExperimentScene(prefix_of(each.name), each.campaign, own, scene, layout))
    return tuple(found)


def simulate_experiments(
    scenes: tuple[ExperimentScene, ...], number: int, row: Any, abort: npt.NDArray[np.uint8]
) -> None:
    """Simulate one sample of all experiments.

    Parameters
    ----------
    scenes
        Of the string.
    number
        Number of the sample in the random streams, each of which depends on one experiment alone.
    row
        Record with the columns of all experiments and of `OUTCOME`, filled.
    abort
        Shape (1,); anything but 0 ends the sample, whose row then has no meaning.
    """
    records = []
    for each in scenes:
        census = new_census_room(each.layout, 1)
        random = random_numbers(each.campaign, each.string, number)
        record, _ = simulate_counted(each.scene, random, census, abort)
        if abort[0]:
            return
        records.append(record[list(OUTCOME.names or ())])
        for name in record.dtype.names:
            row[f"{each.prefix}{name}"] = record[name]
        for name, values in census_values(census).items():
            row[f"{each.prefix}{name}"] = values[0] if record["state"] == COMPLETED else 0
    whole = joined(np.array(records, OUTCOME))
    for name in OUTCOME.names or ():
        row[name] = whole[name]
