"""The experiments of a campaign: each is a campaign of its own with variables of the whole one."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike, NDArray

from agglom_mpi.config.census_layout import common_end
from agglom_mpi.config.data_section import built_data
from agglom_mpi.config.experiments_section import (
    ReadExperiment,
    placed,
    read_experiments,
    read_joint_document,
)
from agglom_mpi.config.given_strings import read_string
from agglom_mpi.config.searchable import check_ends, check_start
from agglom_mpi.config.yaml_source import ArgumentError, CampaignError, Problem, Source, parse
from agglom_mpi.declaration.reading import Reading
from agglom_mpi.formatting import value_with_prefix
from agglom_mpi.measurements.layout import prefix_of
from agglom_mpi.random_streams import experiment_seed
from agglom_mpi.variables import PAPER_VARIABLES, Variable, VariableTable

if TYPE_CHECKING:
    from agglom_mpi.config.campaign import Campaign

Floats = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class CampaignExperiment:
    """An experiment of a campaign.

    Attributes
    ----------
    name
        Its name.
    campaign
        The experiment as a campaign of its own, with its scene, variables and data.
    places
        Place in a string of the whole campaign of each of its own k variables, -1 where it has a
        value of its own, shape (k,).
    """

    name: str
    campaign: "Campaign"
    places: NDArray[np.int64]

    def own(self, strings: ArrayLike) -> Floats:
        """Return the experiment's strings, (…, k), of strings of the whole campaign."""
        taken = np.asarray(strings, np.float64)[..., self.places]
        return np.where(self.places >= 0, taken, self.campaign.variables.lower)


def campaign_of_experiments(
    kind: type["Campaign"], source: Source, text: str, reading: Reading
) -> "Campaign":
    """Return the campaign of a file with experiments; raise a CampaignError.

    Parameters
    ----------
    kind
        Its class.
    source, text
        The file.
    reading
        How it is read.
    """
    read = read_experiments(source, reading)
    table, first = joint_table(read), next(iter(read.values()))
    entries = tuple(entry for each in read.values() for entry in each.document.data)
    document = read_joint_document(source, first.document.scene, table, entries, reading)
    scene, name = first.document.scene, source.name
    shared = kind(**document.for_campaign, scene=scene, variables=table, text=text, name=name)
    found = []
    for name, (own, variables, given) in read.items():
        alone = replace(
            shared,
            scene=own.scene,
            variables=variables,
            data=built_data(own.data, name),
            data_entries=own.data,
            has_layout=True,
        )
        found.append(in_seed(experiment_of(name, alone, given, table), shared.seed))
        try:
            check_ends(alone)
        except CampaignError as error:
            raise CampaignError(*placed(source, {name: error.problems})) from None
    ends = [common_end(each.campaign) for each in found]
    for i, time in enumerate(shared.output.census):
        if time > max(ends):
            message = f"is {value_with_prefix(time, 's')}, which samples of no experiment reach"
            raise CampaignError(source.problem(("output", "census", i), message))
    data = tuple(datum for each in found for datum in each.campaign.data)
    campaign = replace(shared, experiments=tuple(found), data=data, data_entries=entries)
    check_start(campaign, campaign.given_strings())
    return campaign


def joint_table(read: Mapping[str, ReadExperiment]) -> VariableTable:
    """Return the variables of a campaign by those of its experiments."""
    shared, own, differing = dict[str, Variable](), list[Variable](), set[str]()
    tables = {name: each.table for name, each in read.items()}
    for name, table in tables.items():
        for variable in table.variables:
            if variable.is_used and variable.name not in read[name].given:
                before = shared.setdefault(variable.name, variable)
                if before[5:8] != variable[5:8]:  # a size ratio of other laws of sizes
                    differing.add(variable.name)
            elif variable.is_searched:
                named, meaning = f"{prefix_of(name)}{variable.name}", variable.meaning
                meaning = f"{meaning}, in the experiment {name}"
                own.append(variable._replace(name=named, symbol=named, meaning=meaning))
    for name in differing:
        del shared[name]
    of_sizes = next((t for t in tables.values() if "size_ratio" in t.used), None)
    further = [v for v in shared.values() if v.name not in {p.name for p in PAPER_VARIABLES}]
    ignored = {name for table in tables.values() for name in table.ignored} - shared.keys()
    return VariableTable([*further, *own]).with_ranges(
        shared | {variable.name: variable for variable in own},
        ignored=tuple(v.name for v in PAPER_VARIABLES if v.name in ignored),
        by_volume_fraction="size_ratio" in shared
        and of_sizes is not None
        and of_sizes.by_volume_fraction,
        third_moment=1.0 if of_sizes is None else of_sizes.third_moment,
    )


def experiment_of(
    name: str, campaign: "Campaign", given: frozenset[str], whole: VariableTable
) -> CampaignExperiment:
    """Return an experiment of a campaign whose variables are `whole`.

    Parameters
    ----------
    name
    campaign
        The experiment as a campaign of its own.
    given
        Names of the variables that it gives itself.
    whole
    """
    places = []
    for variable in campaign.variables.variables:
        taken = f"{prefix_of(name)}{variable.name}" if variable.name in given else variable.name
        is_there = variable.is_used and taken in whole and whole[taken].is_used
        places.append(whole.index(taken) if is_there else -1)
    return CampaignExperiment(name, campaign, np.array(places, np.int64))


def in_seed(experiment: CampaignExperiment, seed: int) -> CampaignExperiment:
    """Return an experiment of the campaign with another seed."""
    own = replace(experiment.campaign, seed=experiment_seed(seed, experiment.name))
    return replace(experiment, campaign=own)


def joint_warnings(
    campaign: "Campaign", parameters: Mapping[str, float | str] | None
) -> list[Problem]:
    """Return the warnings of all experiments, each once; arguments of `Campaign.warnings`."""
    string = None if parameters is None else read_string(campaign, parameters)
    found = {}
    for each in campaign.experiments:
        alone, given = replace(each.campaign, plan=None), None
        if string is not None:
            given = alone.variables.used_values(each.own(string))
        found[each.name] = alone.warnings(given)
    return placed(parse(campaign.text, campaign.name), found)


def named_experiment(campaign: "Campaign", name: str) -> CampaignExperiment:
    """Return an experiment by its name; raise an ArgumentError if there is none."""
    for each in campaign.experiments:
        if each.name == name:
            return each
    names = _names(campaign)
    allowed = f"allowed: {names}" if names else "the campaign has no section experiments"
    raise ArgumentError.of(campaign.name, "experiment", f"is {name!r}; {allowed}")


def needs_one_scene(campaign: "Campaign", field: str) -> ArgumentError:
    """Return the error of what needs one scene, where each experiment has one."""
    message = (
        f"needs one scene; the campaign has the experiments {_names(campaign)}: simulate one by "
        "agglom simulate --experiment NAME or campaign.experiment(NAME)"
    )
    return ArgumentError.of(campaign.name, field, message)


def _names(campaign: "Campaign") -> str:
    return ", ".join(each.name for each in campaign.experiments)
