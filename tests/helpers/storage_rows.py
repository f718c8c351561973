"""A small campaign file and rows whose content follows from their numbers."""

import json
from pathlib import Path

import numpy as np

from agglom_mpi.config.identity import digest
from agglom_mpi.storage.create import create_campaign_file
from agglom_mpi.storage.room import TableSizes
from agglom_mpi.storage.schema import RESULTS, sample_dtype
from agglom_mpi.storage.table import make_row, sealed

STRINGS, MAX_SAMPLES, GENERATIONS, POPULATION = 40, 100, 5, 6
LOWER = np.array([0.1, 0.4, 1e3, 1e7, 10.0, 0.01, 273.0, 10.0, 5e6, np.nan])
UPPER = np.array([30.0, 0.8, 1e4, 2e8, 1500.0, 0.5, 373.0, 1000.0, 5e6, np.nan])
TEXT = "title: grünes Korn\n" + "# a long remark\n" * 8000


def make(path: Path, **changes: object) -> Path:
    identity = {"particles": 100, "box": [0.1, 30.0]}
    given = {
        "campaign": changes.pop("text", TEXT),
        "campaign_sha256": digest(changes.get("identity", identity)),
        "identity": json.dumps(changes.pop("identity", identity), sort_keys=True),
        "seed": 2**62 + 1,
        "title": "grünes Korn",
        "code_version": "0.1.0",
        "sources_sha256": "s" * 64,
        "purpose": "inversion",
        **changes.pop("own", {}),
    }
    given |= {name: changes.pop(name) for name in given.keys() & changes.keys()}
    box = changes.pop("lower", LOWER), changes.pop("upper", UPPER)
    sizes = table_room(STRINGS, GENERATIONS)._replace(**changes)
    create_campaign_file(path, given, box, sizes)
    return path


def table_room(strings: int, generations: int, **more: object) -> TableSizes:
    """Return sizes of tables with room for these numbers of rows."""
    return TableSizes(strings, MAX_SAMPLES, generations, POPULATION, **more)


def put_status(file, **columns: object) -> None:
    """Change columns of the row of `/status` of an open file, with its checksum."""
    row = file["status"][...]
    for name, value in columns.items():
        row[name] = value
    file["status"][...] = sealed(row)


def sample_rows(string: int, first: int, count: int) -> np.ndarray:
    rows = np.zeros(count, sample_dtype)
    rows["string"] = string
    rows["sample"] = np.arange(first, first + count)
    key = 1000.0 * string + rows["sample"]
    for name in sample_dtype.names[2:-1]:
        rows[name] = 1 if sample_dtype[name].kind == "u" else key
    return rows


def put_strings(writer, first: int, count: int) -> np.ndarray:
    parameters = np.random.default_rng(first).random((count, 10))
    parents = np.tile([-1, 3], (count, 1))
    writer.put_strings(first, 2, np.arange(count), np.ones(count), parents, parameters)
    return parameters


def put_result(writer, string: int, objective: float, used: int = 10, failed: int = 1) -> None:
    row = make_row(
        RESULTS.dtype,
        string=string,
        objective=objective,
        standard_error=0.01,
        mean_radius_ratio=1.9,
        mean_grains=7.0,
        growth_number=6.859,
        samples_used=used,
        failed=failed,
        hit_maximum=string % 2 == 1,
    )
    writer.put_result(row)


def put_generation(writer, generation: int) -> None:
    writer.put_generation(
        generation,
        best_string=3,
        best_objective=0.25,
        best_standard_error=0.01,
        mean_of_top=0.5,
        top=6,
        evaluations=20,
        samples_used=2000,
        samples_simulated=2100,
        seconds=12.5,
        population=np.arange(POPULATION)[::-1],
        digest=2**64 - 1,
    )


def begin_leg(writer, started: float = 1e9) -> int:
    return writer.log.begin_leg(
        started=started,
        ranks=4,
        nodes=2,
        database="gathered",
        host="knöten",
        processor="Z80",
        code_version="0.1.0",
        sources_sha256="s" * 64,
        git_revision="a" * 40,
        python="3.11.7",
        mpi="MPICH " + "x" * 100,
    )
