"""Campaigns whose best strings are estimated again, and what must be in their files."""

import numpy as np

from agglom_mpi.config.loading import load_campaign
from agglom_mpi.outcome import COLUMNS
from agglom_mpi.storage.reader import read_campaign
from agglom_mpi.variables import TEN
from agglom_mpi.verbs.simulate import simulate

FREE = {"seconds", "cpu_seconds", "finished", "rank", "crc"}


def fresh_rows(path):
    """Rows of fresh samples in a file that may not be there yet, by string and number."""
    if not path.exists():
        return np.zeros(0)
    file = read_campaign(path)
    rows = file.all_sample_rows()
    return rows[rows["sample"] >= file.fresh_from]


def fresh_bytes(path):
    """Everything in them that must not depend on how a campaign was run, bit for bit."""
    rows = fresh_rows(path)
    return {name: rows[name].tobytes() for name in rows.dtype.names if name not in FREE}


def best_by_search(path, count):
    """Strings with the lowest objectives of the search."""
    results = read_campaign(path).result_rows()
    return results["string"][np.lexsort((results["string"], results["objective"]))][:count].tolist()


def assert_fresh_are_those_of_the_best(path, campaign_path, strings, samples):
    """Compare fresh samples with what the campaign computes for everybody."""
    file, campaign = read_campaign(path), load_campaign(str(campaign_path))
    first, rows = campaign.ensemble.max_samples, fresh_rows(path)
    best = best_by_search(path, strings)
    wanted = [(string, first + k) for string in sorted(best) for k in range(samples)]
    assert rows[["string", "sample"]].tolist() == wanted
    known = {int(row["string"]): row for row in file.string_rows()}
    for row in rows:
        parameters = np.array([known[int(row["string"])][name] for name in TEN.names])
        record = simulate(campaign, parameters, int(row["sample"])).record
        for column in COLUMNS:
            assert row[column.name].tobytes() == record[column.name].tobytes()
