"""Simulation of one sample of all experiments of a campaign, one after the other."""

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from agglom_mpi.config.campaign import Campaign
from agglom_mpi.measurements.layout import CensusLayout, prefix_of
from agglom_mpi.outcome import COMPLETED, OUTCOME, joined
from agglom_mpi.simulation.census import census_values, new_census_room
from agglom_mpi.simulation.engines import Engine
from agglom_mpi.simulation.sample import simulate_counted
from agglom_mpi.simulation.scene import Scene
from agglom_mpi.verbs.simulate import random_numbers


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
    string: NDArray[np.float64]
    scene: Scene
    layout: CensusLayout


def experiment_scenes(
    campaign: Campaign, parameters: NDArray[np.float64], engine: Engine | None = None
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
    scenes: tuple[ExperimentScene, ...], number: int, row: Any, abort: NDArray[np.uint8]
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
