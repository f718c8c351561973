"""The room of a campaign file: its tables, their rows, and the attributes that state them.

Unwritten rows are holes that take no space on the disk. HDF5 is not needed to know the size.
"""

import json
import math
import re
from collections.abc import Mapping
from functools import cache
from typing import TYPE_CHECKING, Any, Final, NamedTuple, Self

from agglom_mpi.formatting import value_with_prefix
from agglom_mpi.measurements.layout import CensusLayout, Layouts
from agglom_mpi.outcome import SPIN_UNITS
from agglom_mpi.storage.columns import TableSchema
from agglom_mpi.storage.schema import (
    FAILURE_CAPACITY,
    FAILURES,
    FORMAT_VERSION,
    LEARNED,
    LEG_CAPACITY,
    LEGS,
    RESULTS,
    STATUS,
    final_particles_schema,
    frames_schema,
    generations_schema,
    learned_schema,
    samples_schema,
    strings_schema,
    variables_schema,
    volume_schema,
    volume_table,
)
from agglom_mpi.variables import MAX_VARIABLE_NAME, TEN, Variable, VariableTable

if TYPE_CHECKING:
    from agglom_mpi.config.campaign import Campaign

MAX_FILE_BYTES: Final = 10**12
"""Maximum size of a campaign file that is created or enlarged, holes included, bytes."""

FURTHER_VARIABLES: Final = "further_variables"
"""Attribute with name, unit and meaning of the variables beside those of the papers, as JSON."""
QUANTITIES: Final = "quantities"
"""Attribute with the SI units of the quantities of a sample by name, as JSON."""
CENSUS: Final = "census"
"""Attribute with times and classes of the censuses of a sample, as JSON."""
VOLUMES: Final = "volumes"
"""Attribute with the larger control volumes that a file has samples of."""

MAX_CLASSES: Final = 100_000
"""Maximum number of times and classes that an attribute may name."""


class TableSizes(NamedTuple):
    """Sizes of the tables of a campaign file, and what their columns depend on."""

    strings: int
    max_samples: int
    """Samples of each string, without fresh ones."""
    generations: int
    population: int
    fresh: int = 0
    """Fresh samples of each string, and volume, which have the numbers from `max_samples` on."""
    grains: int = 0
    """Particles of a sample in the tables of particles."""
    final_particles: bool = False
    frames: int = 0
    """Frames of all samples together."""
    variables: VariableTable = TEN
    """Variables of the strings."""
    quantities: Mapping[str, str] = {}
    """SI units of the quantities of a sample, by name, in the order of their columns."""
    volumes: tuple[int, ...] = ()
    """Larger control volumes in which there are fresh samples, too, ascending."""
    census: Layouts | None = None
    """Layout of the censuses of a sample, or that of each experiment; None: none are taken."""
    version: int = FORMAT_VERSION
    """Format version of the file."""
    learned: int = 0
    """Samples of another campaign that the search learns from."""

    @classmethod
    def of(cls, attributes: Mapping[str, Any], generations: int = 0) -> Self:
        """Return the sizes that the attributes of a file state; older files lack some of these.

        Raises
        ------
        ValueError
            If a text among them is none that a run writes.
        """
        get, most = attributes.get, int(attributes["max_samples"])
        searched = int(get("fresh_from", most))
        return cls(
            *(int(attributes["strings"]), searched, generations, int(attributes["population"])),
            *(most - searched, int(get("grains", 0)), bool(get("final_particles", 0))),
            int(get("frames", 0)),
            TEN if FURTHER_VARIABLES not in attributes else _variables(get(FURTHER_VARIABLES)),
            _quantities(get(QUANTITIES, "")),
            _volumes(get(VOLUMES, "")),
            _census(get(CENSUS, "")),
            int(get("format_version", FORMAT_VERSION)),
            int(get(LEARNED, 0)),
        )

    @property
    def spins(self) -> bool:
        """Whether the particles of a sample spin; False where it has several experiments."""
        return self.quantities.keys() >= SPIN_UNITS.keys()

    @property
    def sample_room(self) -> int:
        """Samples of each string that there is room for, fresh ones included."""
        return self.max_samples + self.fresh

    def attributes(self) -> dict[str, Any]:
        """Return the attributes that state the sizes; texts of what there is none of are absent."""
        further = [[each.name, each.unit, each.meaning] for each in self.variables.further]
        texts = {
            FURTHER_VARIABLES: json.dumps(further) if further else "",
            QUANTITIES: json.dumps(dict(self.quantities), sort_keys=True) * bool(self.quantities),
            CENSUS: _census_text(self.census) if self.census else "",
            LEARNED: self.learned,
        }
        return self.counts() | {name: text for name, text in texts.items() if text}

    def counts(self) -> dict[str, Any]:
        """Return those that may become larger."""
        volumes = " ".join(map(str, sorted({*self.volumes})))
        return {
            "strings": self.strings,
            "max_samples": self.sample_room,
            "fresh_from": self.max_samples,
            "population": self.population,
            "grains": self.grains,
            "final_particles": int(self.final_particles),
            "frames": self.frames,
        } | ({VOLUMES: volumes} if volumes else {})

    def enlarged(self, asked: "TableSizes") -> Self:
        """Return sizes with at least the room asked for; samples of the search stay as many."""
        names = "strings", "generations", "fresh", "grains", "final_particles", "frames"
        larger = {name: max(getattr(self, name), getattr(asked, name)) for name in names}
        return self._replace(**larger, volumes=tuple(sorted({*self.volumes, *asked.volumes})))

    def tables(self) -> tuple[TableSchema, ...]:
        """Return the schemas of all tables, in the version of the file.

        `/final_particles`, `/frames`, samples of larger volumes and those of another campaign are
        there if the campaign asks for them.
        """
        particles = self.grains, self.spins
        bulk = [final_particles_schema(*particles)] if self.final_particles else []
        bulk += [frames_schema(*particles)] if self.frames else []
        bulk += [volume_schema(each, self.quantities, self.census) for each in self.volumes]
        columns = self.variables, self.quantities, self.census
        bulk += [learned_schema(*columns)] if self.learned else []
        tables = (
            *(variables_schema(self.variables), STATUS, LEGS, strings_schema(self.variables)),
            *(RESULTS, generations_schema(self.population), FAILURES),
            samples_schema(self.quantities, self.census),
            *bulk,
        )
        return tuple(table.at(self.version) for table in tables)

    def capacities(self) -> dict[str, int]:
        """Return how many rows each table has room for, by name."""
        samples = self.strings * self.sample_room
        return {
            "variables": self.variables.count,
            "status": 1,
            "legs": LEG_CAPACITY,
            "failures": FAILURE_CAPACITY,
            "strings": self.strings,
            "results": self.strings,
            "generations": self.generations,
            "samples": samples,
            "final_particles": samples,
            "frames": self.frames,
            LEARNED: self.learned,
        } | {volume_table(volume): self.strings * self.fresh for volume in self.volumes}

    def table_bytes(self) -> dict[str, int]:
        """Return the size of each table, done bytes included, by name."""
        rows = self.capacities()
        return {table.name: rows[table.name] * _row_bytes(table) for table in self.tables()}

    def file_bytes(self) -> int:
        """Return the size of a file, holes included, without what HDF5 adds."""
        return sum(self.table_bytes().values())


def _row_bytes(table: TableSchema) -> int:
    sizes = (int(field.dtype[1:]) * math.prod(field.shape) for field in table.fields)
    return sum(sizes) + int(table.final)


_PATH: Final = re.compile(rf"(?=.{{1,{MAX_VARIABLE_NAME}}}$)[A-Za-z]\w*(\.\w+)*", re.ASCII)


@cache
def _variables(text: str) -> VariableTable:
    found = json.loads(text)
    entries = found if isinstance(found, list) else []
    texts = all(isinstance(e, list) and [*map(type, e)] == [str] * 3 for e in entries)
    if not entries or not texts or not all(_PATH.fullmatch(name) for name, *_ in entries):
        raise ValueError(f"attribute {FURTHER_VARIABLES} is no list of names, units and meanings")
    return VariableTable(Variable(name, unit, name, meaning) for name, unit, meaning in found)


def _quantities(text: str) -> dict[str, str]:
    units = json.loads(text) if text else {}
    if not isinstance(units, dict) or not all(isinstance(unit, str) for unit in units.values()):
        raise ValueError(f"attribute {QUANTITIES} is no JSON object of units")
    return units


def _volumes(text: Any) -> tuple[int, ...]:
    if not isinstance(text, str) or not re.fullmatch(r"([0-9]+( [0-9]+)*)?", text):
        raise ValueError(f"attribute {VOLUMES} is no list of whole numbers")
    volumes = tuple(map(int, text.split()))
    if list(volumes) != sorted({*volumes} - {0, 1}):
        raise ValueError(f"attribute {VOLUMES} is not ascending from 2")
    return volumes


EXPERIMENTS: Final = "experiments"
"""Entry of the attribute `CENSUS` with the layout of each experiment, in their order."""


def _census_text(layout: Layouts) -> str:
    """Return a layout as JSON: times in s, null for the end; edges are diameters over 2 b0."""
    if not isinstance(layout, CensusLayout):
        own = {name: _census_entries(each) for name, each in layout.items()}
        return json.dumps({EXPERIMENTS: own})
    return json.dumps(_census_entries(layout))


def _census_entries(layout: CensusLayout) -> dict[str, Any]:
    times = [time if math.isfinite(time) else None for time in layout.times]
    entries = {"times": times, "lower": layout.lower, "classes": layout.classes}
    return entries | {"edges": layout.edges.tolist()}


def _census(text: str) -> Layouts | None:
    if not text:
        return None
    try:
        entries = json.loads(text)
    except ValueError:
        entries = None
    if isinstance(entries, dict) and isinstance(own := entries.get(EXPERIMENTS), dict) and own:
        return {name: _layout(each) for name, each in own.items()}
    return _layout(entries)


def _layout(entries: Any) -> CensusLayout:
    try:
        times = tuple(math.inf if time is None else float(time) for time in entries["times"])
        layout = CensusLayout(times, float(entries["lower"]), int(entries["classes"]))
        whole = 0 < layout.classes <= MAX_CLASSES and 0 < len(times) <= MAX_CLASSES
        if whole and math.isfinite(layout.lower) and list(times) == sorted(set(times)):
            return layout
    except (KeyError, TypeError, ValueError):
        pass
    raise ValueError(f"attribute {CENSUS} is no JSON object of possible times and classes")


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
        campaign.sample_quantities,
        campaign.final.larger if campaign.final else (),
        campaign.census,
    )


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
    needed = sizes.file_bytes()
    if needed <= max(MAX_FILE_BYTES, present):
        return
    # Imported here: a file is read without what reads a campaign's text.
    from agglom_mpi.config.yaml_source import CampaignError, parse

    largest = sizes.table_bytes()
    table = max(largest, key=largest.__getitem__)
    if table in ("final_particles", "frames"):
        path: tuple[str, ...] = "output", table
    else:
        path = ("stopping", "generations") if sizes.generations > 1 else ("ensemble",)
    message = (
        f"needs a campaign file with room for {size_text(needed)}; must be at most "
        f"{size_text(MAX_FILE_BYTES)}: ask for less, as fewer generations or samples; a finished "
        "campaign goes on when it is run again with more generations"
    )
    raise CampaignError(parse(campaign.text, campaign.name).problem(path, message))
