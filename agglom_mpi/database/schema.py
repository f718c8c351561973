"""The tables of a campaign file: one place for every column, its unit and its meaning."""

from collections.abc import Mapping
from typing import Any, Final

from agglom_mpi.database.bulk import final_particles_layout, frames_layout
from agglom_mpi.database.layout import CRC, Field, Layout
from agglom_mpi.simulation.outcome import COLUMNS
from agglom_mpi.variables import VARIABLES

FORMAT: Final = "agglom_mpi campaign"
FORMAT_VERSION: Final = 1
"""What is written; files of any version from 1 up to this one are read."""

INVERSION: Final = "inversion"
"""What strings of a file are for, if a campaign searched with them."""
STUDY: Final = "accuracy study"
"""What they are for, if they are set-ups to be compared."""

ORIGINS: Final = ("random", "offspring", "model", "given", "again")
"""Where a string comes from, by its `origin`."""
STATES: Final = ("", "completed", "failed")
"""How a sample ended, by its `state`."""
CAMPAIGN_STATES: Final = ("running", "stopped", "finished", "failed")

TOOK_TOO_LONG: Final = "took longer than max_seconds,"
"""How the text of a failure begins that is no exception; its sample has no row in `/samples`."""

FAILURE_CAPACITY: Final = 1000
LEG_CAPACITY: Final = 1000

VARIABLE_TABLE: Final = Layout(
    "variables",
    "the search variables and their box",
    "row = position in a parameter string",
    (
        Field("name", "S32", "", "name of the variable"),
        Field("unit", "S16", "", "its SI unit"),
        Field("lower", "f8", "the variable's", "lower bound; nan if the campaign does not use it"),
        Field("upper", "f8", "the variable's", "upper bound; equal to lower if it is fixed"),
        Field("searched", "u1", "", "1 searched, 0 fixed or unused"),
    ),
)

STRINGS: Final = Layout(
    "strings",
    "the parameter strings, stored before their samples are simulated",
    "row = string",
    (
        Field("string", "i8", "", "number of the string, its row"),
        Field("generation", "i4", "", "generation that it was proposed for, from 0"),
        Field("slot", "i4", "", "its place among the strings of that generation"),
        Field(
            "origin",
            "u1",
            "",
            "0 random, 1 offspring, 2 of a model, 3 given, 4 a parent that gets more samples",
        ),
        Field("parents", "i8", "", "strings that it was bred from, -1 for none", (2,)),
        *(Field(v.name, "f8", v.unit, v.meaning) for v in VARIABLES),
        CRC,
    ),
)

RESULTS: Final = Layout(
    "results",
    "the judgement of each string over its ensemble of samples",
    "row = string",
    (
        Field("string", "i8", "", "number of the string, its row"),
        Field("objective", "f8", "1", "objective of the ensemble, smaller is better"),
        Field("standard_error", "f8", "1", "standard error of the objective"),
        Field("mean_radius_ratio", "f8", "1", "ensemble mean of b/b0"),
        Field("mean_grains", "f8", "1", "grains per particle left, ensemble mean"),
        Field("growth_number", "f8", "1", "n^f, the cube of the ensemble mean of b/b0"),
        Field("samples_used", "i8", "1", "samples judged, failed ones included"),
        Field("failed", "i8", "1", "samples that failed among those judged"),
        Field(
            "hit_maximum", "u1", "", "1 if max_samples ended the ensemble, not its stopping rule"
        ),
        CRC,
    ),
)

SAMPLES: Final = Layout(
    "samples",
    "one simulated configuration of one string; those with sample < samples_used are used",
    "row = string * max_samples + sample",
    (
        Field("string", "i8", "", "number of the string"),
        Field("sample", "i8", "", "number of the sample in its string, from 0"),
        *(Field(*column) for column in COLUMNS),
        Field("objective", "f8", "1", "objective of this sample alone"),
        Field("seconds", "f8", "s", "time that the simulation took"),
        Field("finished", "f8", "s", "Unix time of its end"),
        Field("rank", "i4", "", "MPI rank that simulated it"),
        CRC,
    ),
)
sample_dtype: Final = SAMPLES.dtype
"""One row of `/samples`; what the farm hands to the writer, `crc` not filled in."""

FAILURES: Final = Layout(
    "failures",
    "exceptions of failed samples; when the table is full the last row is overwritten, unless that "
    "sample took too long",
    "row = order of arrival",
    (
        Field("string", "i8", "", "number of the string"),
        Field("sample", "i8", "", "number of the sample in its string, from 0"),
        Field("rank", "i4", "", "MPI rank that simulated it"),
        Field("host", "S64", "", "machine of that rank"),
        Field("text", "S1000", "", "the exception; of a long text the end"),
        CRC,
    ),
)

LEGS: Final = Layout(
    "legs",
    "starts of the program; when the table is full the last row is overwritten",
    "row = leg",
    (
        Field("started", "f8", "s", "Unix time of the start"),
        Field("stopped", "f8", "s", "Unix time of the end, nan while running or when killed"),
        Field("ranks", "i4", "1", "MPI ranks"),
        Field("nodes", "i4", "1", "machines that they were on"),
        Field("database", "S16", "", "who wrote samples: gathered, rank 0; parallel, every rank"),
        Field("exit_code", "i4", "", "exit code, -1 while running or when killed"),
        Field("host", "S64", "", "machine of rank 0"),
        Field("processor", "S64", "", "its kind of processor"),
        Field("code_version", "S32", "", "version of agglom_mpi"),
        Field("python", "S64", "", "version of Python"),
        Field("numpy", "S64", "", "version of NumPy"),
        Field("numba", "S64", "", "version of Numba"),
        Field("h5py", "S64", "", "version of h5py"),
        Field("hdf5", "S64", "", "version of HDF5"),
        Field("mpi", "S64", "", "MPI library"),
        Field("sources_sha256", "S64", "", "SHA-256 of the simulation sources"),
        Field("git_revision", "S64", "", "commit of the sources, empty if they are no checkout"),
        Field("samples", "i8", "1", "samples simulated in this leg"),
        Field("busy_seconds", "f8", "s", "sum of the time that they took"),
        Field("database_seconds", "f8", "s", "time spent on writing this file, sum over ranks"),
        CRC,
    ),
)
VERSIONS: Final = ("python", "numpy", "numba", "h5py", "hdf5", "mpi")
"""The columns of `/legs` that record library versions."""

STATUS: Final = Layout(
    "status",
    "what the campaign is doing; rewritten in place",
    "one row",
    (
        Field("state", "S16", "", ", ".join(CAMPAIGN_STATES)),
        Field("updated", "f8", "s", "Unix time of the last change"),
        Field("reason", "S128", "", "why it is in this state"),
    ),
)


DIGEST_MEANING: Final = (
    "BLAKE2b (digest_size 8, read as little-endian) of what the generation rests on: of strings "
    "proposed for it, by number, the ten parameters; then of their /results all columns but crc; "
    "then of their used /samples, by string and sample, all columns but seconds, finished, rank "
    "and crc; row after row, the columns in their order here, little-endian and without padding"
)


def fresh_from(attributes: Mapping[str, Any]) -> int:
    """Return the number of the first fresh sample of each string; older files have no room for any.

    The rows of `/samples` of one string are `max_samples` wide; no decision sees the last of them.
    """
    return int(attributes.get("fresh_from", attributes["max_samples"]))


def generations_layout(population: int) -> Layout:
    """Layout of `/generations` for a population of so many strings."""
    return Layout(
        "generations",
        "the search after each generation",
        "row = generation",
        (
            Field("generation", "i8", "", "number of the generation, its row"),
            Field("best_string", "i8", "", "string with the lowest objective so far"),
            Field("best_objective", "f8", "1", "its objective"),
            Field("best_standard_error", "f8", "1", "standard error of that"),
            Field("mean_of_top", "f8", "1", "mean objective of the best `top` strings"),
            Field("top", "i4", "1", "strings in that mean"),
            Field("evaluations", "i8", "1", "strings judged so far"),
            Field("samples_used", "i8", "1", "samples that they used, so far"),
            Field("samples_simulated", "i8", "1", "samples simulated so far, used or not"),
            Field("seconds", "f8", "s", "wall-clock time so far, summed over legs"),
            Field("population", "i8", "", "strings in rank order, the best first", (population,)),
            Field("digest", "u8", "", DIGEST_MEANING),
            CRC,
        ),
    )


def layouts(attributes: Mapping[str, Any]) -> tuple[Layout, ...]:
    """All tables of a campaign file with such attributes; those not asked for are left out."""
    grains = int(attributes.get("grains", 0))
    bulk = []
    if attributes.get("final_particles", 0):
        bulk.append(final_particles_layout(grains))
    if attributes.get("frames", 0):
        bulk.append(frames_layout(grains))
    return (
        VARIABLE_TABLE,
        STATUS,
        LEGS,
        STRINGS,
        RESULTS,
        generations_layout(int(attributes["population"])),
        FAILURES,
        SAMPLES,
        *bulk,
    )
