"""The room of a campaign file: how many rows each table is laid out for, and the size of the file.

Unwritten rows are holes that take no space on the disk. HDF5 is not needed to know the size.
"""

import math
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any, Final, NamedTuple

from agglom_mpi.formatting import value_with_prefix
from agglom_mpi.measurements.layout import CensusLayout
from agglom_mpi.storage.columns import census_attributes
from agglom_mpi.storage.schema import (
    FAILURE_CAPACITY,
    LEG_CAPACITY,
    TableSchema,
    fresh_room,
    quantity_attributes,
    table_schemas,
    volume_attributes,
    volume_table,
    volumes_of_file,
)
from agglom_mpi.storage.stored_variables import variable_attributes, variables_of
from agglom_mpi.variables import TEN, VariableTable

if TYPE_CHECKING:
    from agglom_mpi.config.campaign import Campaign

MAX_FILE_BYTES: Final = 10**12
"""Maximum size of a campaign file that is created or enlarged, holes included, bytes."""


class TableSizes(NamedTuple):
    """Sizes of the tables of a campaign file."""

    strings: int
    max_samples: int
    """Samples of each string, without fresh ones."""
    generations: int
    population: int
    fresh: int = 0
    """Fresh samples of each string, which have the numbers from `max_samples` on."""
    grains: int = 0
    """Particles of a sample in the tables of particles."""
    final_particles: bool = False
    frames: int = 0
    """Frames of all samples together."""
    variables: VariableTable = TEN
    """Variables of the strings."""
    quantities: Mapping[str, str] = {}
    """SI units of the quantities of a sample, by name."""
    volumes: tuple[int, ...] = ()
    """Larger control volumes in which there are fresh samples, too."""
    census: CensusLayout | None = None
    """Layout of the censuses of a sample; None: none are taken."""


def table_sizes(campaign: "Campaign") -> TableSizes:
    """Return the sizes for all generations that a campaign allows."""
    output, frames = campaign.output, campaign.output.frames
    strings, samples = campaign.max_framed
    return TableSizes(
        campaign.max_strings,
        campaign.ensemble.max_samples,
        campaign.stopping.generations,
        campaign.search.population,
        campaign.final.samples if campaign.final else 0,
        campaign.scene.particles if output.final_particles or frames else 0,
        output.final_particles,
        strings * samples * frames.count if frames else 0,
        campaign.variables,
        campaign.objective.quantity_units,
        campaign.final.larger if campaign.final else (),
        campaign.census,
    )


def capacities(attributes: Mapping[str, Any], generations: int) -> dict[str, int]:
    """Return how many rows each table of a file with these attributes has room for, by name."""
    strings = int(attributes["strings"])
    samples = strings * int(attributes["max_samples"])
    fresh = strings * fresh_room(attributes)
    volumes = {volume_table(volume): fresh for volume in volumes_of_file(attributes)}
    return {
        "variables": variables_of(attributes).count,
        "status": 1,
        "legs": LEG_CAPACITY,
        "failures": FAILURE_CAPACITY,
        "strings": strings,
        "results": strings,
        "generations": generations,
        "samples": samples,
        "final_particles": samples,
        "frames": int(attributes.get("frames", 0)),
        **volumes,
    }


def table_bytes(sizes: TableSizes) -> dict[str, int]:
    """Return the size of each table of a file, done bytes included, by name."""
    attributes = sizes._asdict() | {
        "max_samples": sizes.max_samples + sizes.fresh,
        "fresh_from": sizes.max_samples,
    }
    del attributes["volumes"], attributes["census"]
    attributes |= variable_attributes(sizes.variables) | quantity_attributes(sizes.quantities)
    attributes |= volume_attributes(sizes.volumes) | census_attributes(sizes.census)
    rows = capacities(attributes, sizes.generations)
    return {table.name: rows[table.name] * _row_bytes(table) for table in table_schemas(attributes)}


def file_bytes(sizes: TableSizes) -> int:
    """Return the size of a file, holes included, without what HDF5 adds."""
    return sum(table_bytes(sizes).values())


def _row_bytes(table: TableSchema) -> int:
    sizes = (int(field.dtype[1:]) * math.prod(field.shape) for field in table.fields)
    return sum(sizes) + int(table.final)


def size_text(size: int) -> str:
    """Return a number of bytes to three digits: `4.9 MB`, `2.35 TB`."""
    return f"{size / 1e12:.3g} TB" if size >= 10**12 else value_with_prefix(size, "B")


def check_room(campaign: "Campaign", sizes: TableSizes, present: int = 0) -> None:
    """Raise a CampaignError if the file of a campaign would be larger than is allowed.

    Parameters
    ----------
    campaign
        Named in the error.
    sizes
        Of the file.
    present
        Size of the file that is there already, bytes: it need not grow.
    """
    needed = file_bytes(sizes)
    if needed <= max(MAX_FILE_BYTES, present):
        return
    # Imported here: a file is read without what reads a campaign's text.
    from agglom_mpi.config.yaml_source import CampaignError, parse

    path, remedy = _remedy(campaign, sizes)
    message = (
        f"needs a campaign file with room for {size_text(needed)}; must be at most "
        f"{size_text(MAX_FILE_BYTES)}: {remedy}"
    )
    raise CampaignError(parse(campaign.text, campaign.name).problem(path, message))


def _remedy(campaign: "Campaign", sizes: TableSizes) -> tuple[tuple[str, ...], str]:
    """Return the field of a campaign to change so that its file becomes smaller, and how."""
    if sizes.generations > 1 and (most := _most_generations(campaign)):
        again = "a finished campaign goes on when it is run again with more"
        return ("stopping", "generations"), f"ask for at most {most:,} generations; {again}"
    largest = table_bytes(sizes)
    match max(largest, key=largest.__getitem__):
        case "final_particles":
            return (
                "output",
                "final_particles",
            ), "leave out the final particles, or take fewer samples"
        case "frames":
            return ("output", "frames"), "take fewer frames, of fewer strings or samples"
        case _:
            return ("ensemble",), "take fewer samples of a string, or fewer strings in a generation"


def _most_generations(campaign: "Campaign") -> int:
    """Return the number of generations for which the file is as large as is allowed."""
    fits, too_many = 0, campaign.stopping.generations
    while too_many - fits > 1:
        middle = (fits + too_many) // 2
        if file_bytes(table_sizes(campaign.with_generations(middle))) <= MAX_FILE_BYTES:
            fits = middle
        else:
            too_many = middle
    return fits
