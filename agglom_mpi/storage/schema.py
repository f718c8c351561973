"""The tables of a campaign file: their columns with unit and meaning.

Columns of a sample's outcome are declared in `outcome`, those of the variables in `variables`.
"""

from collections.abc import Mapping
from typing import Final

import numpy as np

from agglom_mpi.measurements.layout import Layouts
from agglom_mpi.outcome import COLUMNS, SPIN_COLUMNS
from agglom_mpi.storage.columns import CRC, Column, TableSchema, census_columns
from agglom_mpi.variables import MAX_VARIABLE_NAME, TEN, VariableTable

FORMAT: Final = "agglom_mpi campaign"
FORMAT_VERSION: Final = 6
"""Version of the files written; files of versions from 1 up to this one are read."""
CHECKED_SINCE: Final = 6
"""First version with checksums of attributes, of `/variables` and of `/status`."""

INVERSION: Final = "inversion"
"""Purpose of the strings of a campaign, which a search proposed."""
STUDY: Final = "accuracy study"
"""Purpose of the strings of a study, which are set-ups to be compared."""
CERTIFICATE: Final = "certificate of a feasible set"
"""Purpose of strings that were drawn from a feasible set, to test it."""

STATES: Final = ("", "completed", "failed")
"""Texts of the codes in the column `state` of `/samples`."""
CAMPAIGN_STATES: Final = ("running", "stopped", "finished", "failed")

BY_SAMPLE: Final = "row = string * max_samples + sample"
"""Which row is which in tables of samples."""

TOOK_TOO_LONG: Final = "took longer than max_seconds,"
"""Prefix of the text of a failure that is a timeout; its sample has no row in `/samples`."""

IN_VOLUME: Final = "row = string * (max_samples - fresh_from) + sample - fresh_from"
"""Which row is which in a table of samples of a larger control volume."""

FAILURE_CAPACITY: Final = 1000
LEG_CAPACITY: Final = 1000


VARIABLE_TABLE: Final = TableSchema(
    "variables",
    "the search variables and their box",
    "row = position in a parameter string",
    (
        Column("name", "S32", "", "name of the variable"),
        Column("unit", "S16", "", "its SI unit"),
        Column("lower", "f8", "the variable's", "lower bound; nan if the campaign does not use it"),
        Column("upper", "f8", "the variable's", "upper bound; equal to lower if it is fixed"),
        Column("searched", "u1", "", "1 searched, 0 fixed or unused"),
    ),
)

STRING_COLUMNS: Final = (
    Column("string", "i8", "", "number of the string, its row"),
    Column("generation", "i4", "", "generation that it was proposed for, from 0"),
    Column("slot", "i4", "", "its place among the strings of that generation"),
    Column(
        *("origin", "u1", ""),
        "0 random, 1 offspring, 2 of a model, 3 given, 4 a parent that gets more samples",
    ),
    Column("parents", "i8", "", "strings that it was bred from, -1 for none", (2,)),
)
"""Columns of `/strings` before those of the variables."""


def variables_schema(variables: VariableTable = TEN) -> TableSchema:
    """Return the schema of `/variables`, wide enough for the longest name."""
    name, *others = VARIABLE_TABLE.fields
    if max(len(each.encode()) for each in variables.names) <= int(name.dtype[1:]):
        return VARIABLE_TABLE
    wide = name._replace(dtype=f"S{MAX_VARIABLE_NAME}")
    return VARIABLE_TABLE._replace(fields=(wide, *others))


def strings_schema(variables: VariableTable = TEN) -> TableSchema:
    """Return the schema of `/strings` for the variables of a campaign."""
    return TableSchema(
        "strings",
        "the parameter strings, stored before their samples are simulated",
        "row = string",
        (
            *STRING_COLUMNS,
            *(Column(v.name, "f8", v.unit, v.meaning) for v in variables.variables),
            CRC,
        ),
    )


def variable_names(dtype: np.dtype) -> tuple[str, ...]:
    """Return the names of the variables in the type of a row of `/strings`."""
    return (dtype.names or ())[len(STRING_COLUMNS) : -1]


def parameters_of(strings: np.ndarray) -> np.ndarray:
    """Return the parameters in rows of `/strings`, shape (n, k), in SI units."""
    return np.column_stack([strings[name] for name in variable_names(strings.dtype)])


RESULTS: Final = TableSchema(
    "results",
    "the judgement of each string over its ensemble of samples",
    "row = string",
    (
        Column("string", "i8", "", "number of the string, its row"),
        Column("objective", "f8", "1", "objective of the ensemble, smaller is better"),
        Column("standard_error", "f8", "1", "standard error of the objective"),
        Column("mean_radius_ratio", "f8", "1", "ensemble mean of b/b0"),
        Column("mean_grains", "f8", "1", "grains per particle left, ensemble mean"),
        Column("growth_number", "f8", "1", "n^f, the cube of the ensemble mean of b/b0"),
        Column("samples_used", "i8", "1", "samples judged, failed ones included"),
        Column("failed", "i8", "1", "samples that failed among those judged"),
        Column(
            "hit_maximum", "u1", "", "1 if max_samples ended the ensemble, not its stopping rule"
        ),
        CRC,
    ),
)

SAMPLE_KEY: Final = (
    Column("string", "i8", "", "number of the string"),
    Column("sample", "i8", "", "number of the sample in its string, from 0"),
)
"""Columns of tables of samples that state which sample a row is of."""

SAMPLES: Final = TableSchema(
    "samples",
    "one simulated configuration of one string; those with sample < samples_used are used",
    BY_SAMPLE,
    (
        *SAMPLE_KEY,
        *(Column(c.name, c.dtype, c.unit, c.meaning, since=c.since) for c in COLUMNS),
        Column("objective", "f8", "1", "objective of this sample alone"),
        Column("seconds", "f8", "s", "wall-clock time of its simulation"),
        Column(
            "cpu_seconds",
            "f8",
            "s",
            "processor time of its simulation by the thread that simulates: its kernel; on the "
            "last sample of a range also the Python code around these",
            since=3,
        ),
        Column("finished", "f8", "s", "Unix time of its end"),
        Column("rank", "i4", "", "MPI rank that simulated it"),
        CRC,
    ),
)
"""Samples without quantities and censuses; see `samples_schema`."""
sample_dtype: Final = SAMPLES.dtype
"""One row of `/samples`; what a run hands to the writer, `crc` not filled in."""


def samples_schema(quantities: Mapping[str, str], census: Layouts | None = None) -> TableSchema:
    """Return the schema of `/samples` with columns of quantities, by the order of their names.

    Parameters
    ----------
    quantities
        Their SI units by name, those of `SPIN_COLUMNS` among them where grains spin.
    census
        Layout of the censuses of a sample, whose columns follow those; of several experiments, that
        of each. Columns without the name of an experiment are then of all: `state`, `reason`, the
        numbers of what happened and the largest errors; or of the first one.
    """
    if not quantities and census is None:
        return SAMPLES
    usual, columns = "quantity of the sample by the objective's function", []
    of_spins = {column.name: column.meaning for column in SPIN_COLUMNS}
    for name, unit in sorted(quantities.items()):
        meaning = of_spins.get(name.rpartition(".")[2], usual)
        columns.append(Column(name, "f8", unit, f"{meaning}; 0 if it failed", since=4))
    columns += census_columns(census)
    at = [field.name for field in SAMPLES.fields].index("objective") + 1
    return SAMPLES._replace(fields=(*SAMPLES.fields[:at], *columns, *SAMPLES.fields[at:]))


def volume_table(volume: int) -> str:
    """Return the name of the table of the samples of a larger control volume."""
    return f"samples_volume_{volume}"


def volume_schema(
    volume: int, quantities: Mapping[str, str], census: Layouts | None = None
) -> TableSchema:
    """Return the schema of the samples of a larger control volume, with the columns of `/samples`.

    Parameters
    ----------
    volume
        Volume of the box, and number of grains, relative to those of `/samples`.
    quantities, census
        As for `samples_schema`.
    """
    meaning = (
        f"fresh samples of the best strings with {volume} times the grains, of the same size, in "
        f"a box of {volume} times the volume; the objective is that of the campaign's own number "
        "of grains"
    )
    return samples_schema(quantities, census)._replace(
        name=volume_table(volume), meaning=meaning, row=IN_VOLUME
    )


LEARNED: Final = "learned"
"""Name of the table of samples of other campaigns that a search learns from."""
LEARNED_FROM: Final = "learned_from"
"""Attribute with the name of that campaign's file, as the campaign gives it."""
LEARNED_SHA256: Final = "learned_from_sha256"
"""Attribute with the `campaign_sha256` of that file."""
LEARNED_FAVOURS_LOW: Final = "learned_favours_low"
"""Attribute: 1 if a search for the best proposed some of its strings by the results of others."""
LEARNED_STRING: Final = "learned_string"
"""Column of that table with the string of a sample."""


def learned_schema(
    variables: VariableTable, quantities: Mapping[str, str], census: Layouts | None = None
) -> TableSchema:
    """Return the schema of `/learned`: the string of a sample, and the columns of `/samples`."""
    meaning = "its string in SI units, in the order of /variables"
    string = Column(LEARNED_STRING, "f8", "the variables'", meaning, (variables.count,))
    samples = samples_schema(quantities, census)
    return samples._replace(
        name=LEARNED,
        meaning="samples of the campaign that `learned_from` names, with their numbers and "
        "objectives there: data of emulators, no results of this campaign",
        row="row = sample, by string",
        fields=(string, *samples.fields),
    )


FAILURES: Final = TableSchema(
    "failures",
    "exceptions of failed samples; when the table is full the last row is overwritten, unless that "
    "sample took too long",
    "row = order of arrival",
    (
        *SAMPLE_KEY,
        Column("rank", "i4", "", "MPI rank that simulated it"),
        Column("host", "S64", "", "machine of that rank"),
        Column("text", "S1000", "", "the exception; of a long text the first line and the end"),
        CRC,
    ),
)

LEGS: Final = TableSchema(
    "legs",
    "starts of the program; when the table is full the last row is overwritten",
    "row = leg",
    (
        Column("started", "f8", "s", "Unix time of the start"),
        Column("stopped", "f8", "s", "Unix time of the end, nan while running or when killed"),
        Column("ranks", "i4", "1", "MPI ranks"),
        Column("nodes", "i4", "1", "machines that they were on"),
        Column("database", "S16", "", "who wrote samples: gathered, rank 0; parallel, every rank"),
        Column("exit_code", "i4", "", "exit code, -1 while running or when killed"),
        Column("host", "S64", "", "machine of rank 0"),
        Column("processor", "S64", "", "its kind of processor"),
        Column("code_version", "S32", "", "version of agglom_mpi"),
        Column("python", "S64", "", "version of Python"),
        Column("numpy", "S64", "", "version of NumPy"),
        Column("numba", "S64", "", "version of Numba"),
        Column("h5py", "S64", "", "version of h5py"),
        Column("hdf5", "S64", "", "version of HDF5"),
        Column("mpi", "S64", "", "MPI library"),
        Column("scipy", "S64", "", "version of SciPy", since=2),
        Column("sources_sha256", "S64", "", "SHA-256 of the sources that decide results"),
        Column("git_revision", "S64", "", "commit of the sources, empty if they are no checkout"),
        Column("samples", "i8", "1", "samples simulated in this leg"),
        Column("busy_seconds", "f8", "s", "wall-clock time of their simulation, sum over ranks"),
        Column(
            "cpu_seconds", "f8", "s", "processor time of their simulation, sum over ranks", since=3
        ),
        Column(
            "database_seconds",
            "f8",
            "s",
            "wall-clock time spent on writing this file, sum over ranks",
        ),
        CRC,
    ),
)

STATUS: Final = TableSchema(
    "status",
    "what the campaign is doing; rewritten in place",
    "one row",
    (
        Column("state", "S16", "", ", ".join(CAMPAIGN_STATES)),
        Column("updated", "f8", "s", "Unix time of the last change"),
        Column("reason", "S128", "", "why it is in this state"),
        CRC._replace(since=CHECKED_SINCE),
    ),
)


DIGEST_MEANING: Final = (
    "BLAKE2b (digest_size 8, read as little-endian) of what the generation rests on: of strings "
    "proposed for it, by number, the parameters; then of their /results all columns but crc; "
    "then of their used /samples, by string and sample, all columns but seconds, cpu_seconds, "
    "finished, rank and crc; row after row, the columns in their order here, little-endian and "
    "without padding"
)


def generations_schema(population: int) -> TableSchema:
    """Return the schema of `/generations` for a population of `population` strings."""
    return TableSchema(
        "generations",
        "the search after each generation",
        "row = generation",
        (
            Column("generation", "i8", "", "number of the generation, its row"),
            Column("best_string", "i8", "", "string with the lowest objective so far"),
            Column("best_objective", "f8", "1", "its objective"),
            Column("best_standard_error", "f8", "1", "standard error of that"),
            Column("mean_of_top", "f8", "1", "mean objective of the best `top` strings"),
            Column("top", "i4", "1", "strings in that mean"),
            Column("evaluations", "i8", "1", "strings judged so far"),
            Column("samples_used", "i8", "1", "samples that they used, so far"),
            Column("samples_simulated", "i8", "1", "samples simulated so far, used or not"),
            Column("seconds", "f8", "s", "wall-clock time so far, summed over legs"),
            Column("population", "i8", "", "strings in rank order, the best first", (population,)),
            Column("digest", "u8", "", DIGEST_MEANING),
            CRC,
        ),
    )


def _particle_columns(grains: int, spins: bool) -> tuple[Column, ...]:
    wide = (grains,)
    spin = Column("spin", "f8", "rad/s", "angular velocities, of grains that spin", (grains, 3))
    return (
        Column("radius", "f8", "m", "radii", wide),
        Column("mass", "f8", "kg", "masses", wide),
        Column("temperature", "f8", "K", "temperatures", wide),
        Column("grains", "i8", "1", "original grains in each", wide),
        *((spin,) if spins else ()),
    )


def final_particles_schema(grains: int, spins: bool = False) -> TableSchema:
    """Return the schema of `/final_particles`, whose arrays are `grains` long."""
    return TableSchema(
        "final_particles",
        "the particles left at the end of each sample, in the first places of each array; the "
        "others are nan, or 0 grains",
        BY_SAMPLE,
        (
            *SAMPLE_KEY,
            Column("particles", "i8", "1", "particles left"),
            *_particle_columns(grains, spins),
            CRC,
        ),
    )


def frames_schema(grains: int, spins: bool = False) -> TableSchema:
    """Return the schema of `/frames`, whose arrays are `grains` long."""
    wide, vectors = (grains,), (grains, 3)
    return TableSchema(
        "frames",
        "pictures of some samples of the best strings, in the first places of each array; the "
        "others are nan, 0 grains and the label -1",
        "row = a sample's place among those chosen * frames of each + frame",
        (
            *SAMPLE_KEY,
            Column("frame", "i8", "", "number of the picture, from 0"),
            Column("time", "f8", "s", "when it was taken"),
            Column("particles", "i8", "1", "particles there are"),
            Column("label", "i8", "", "who is who, from frame to frame", wide),
            Column("position", "f8", "m", "centres, wrapped into the box from -D to D", vectors),
            Column("velocity", "f8", "m/s", "velocities", vectors),
            *_particle_columns(grains, spins),
            CRC,
        ),
    )
