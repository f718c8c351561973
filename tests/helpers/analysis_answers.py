"""All analyses of a campaign file as bytes, and files that differ in what ran ahead unused."""

import json
import shutil

import numpy as np
import pandas as pd
from click.testing import CliRunner
from measured_runs import write_measured
from set_runs import three_variable_text

from agglom_mpi.analysis.failed_samples import failure_lines
from agglom_mpi.analysis.run_warnings import run_warnings
from agglom_mpi.cli import main
from agglom_mpi.report.figures.ensembles import running_estimate
from agglom_mpi.report.netcdf import PREFIX, sample_arrays
from agglom_mpi.report.sample_particles import completed_samples
from agglom_mpi.report.sections.run import LEDGER_COLUMNS, ledger_table
from agglom_mpi.storage.reader import read_campaign
from agglom_mpi.storage.writer import CampaignWriter

OF_THE_RUN = {"file", "seconds", "samples_per_second", "samples_simulated", "processor_seconds"}
"""Entries of JSON that say how the run went."""
TIMES = ("seconds", "cpu_seconds", "finished", "rank", "samples_simulated")
"""Columns, without their units, that do."""
RULE = "{rule: standard_error, tolerance: 0.1, min_samples: 3, max_samples: 7}"
FINAL = "{strings: 3, samples: 5}"


def write_three(folder, search, stopping, rule=RULE):
    """Write `three.yaml`, whose strings stop at different numbers of samples."""
    text = three_variable_text(search=search, ensemble=rule, final=FINAL, stopping=stopping)
    (folder / "three.yaml").write_text(text)
    return "three.yaml"


def write_data(folder):
    """Write `measured.yaml`, which ends after its first generation of 12 strings."""
    write_measured(
        folder,
        stop=("{generations: 3}", "{generations: 4, target: {top: 1, objective: 1e12}}"),
        size=("population: 6", "population: 12"),
        rule=("{rule: fixed, samples: 3}", RULE),
    )
    return "measured.yaml"


def run_ahead(path, copy, samples, strings):
    """Copy a file and add completed and failed samples that ran ahead unused, unlike all others.

    There are up to `samples` more of each judged string, and `strings` that none has judged.
    """
    shutil.copy(path, copy)
    file = read_campaign(copy)
    rows, proposed, used = file.all_sample_rows(), file.string_rows(), file.samples_used
    made = []
    for string, count in used.items():
        for sample in range(count, min(count + samples, file.fresh_from)):
            made.append(_unlike(rows[rows["string"] == string][:1], string, sample))
    first = len(proposed)
    for string in range(first, first + strings):
        made.append(_unlike(rows[:1], string, 0))
    random = np.random.default_rng(samples)
    lower, upper = file.variable_rows()["lower"], file.variable_rows()["upper"]
    values = lower + random.random((strings, len(lower))) * (upper - lower)
    generation = len(file.generation_rows())
    with CampaignWriter(copy) as writer:
        parents = np.full((strings, 2), -1)
        writer.put_strings(first, generation, np.arange(strings), 0, parents, values)
        writer.put_samples(np.concatenate(made))
    # The run may have simulated the same strings ahead, which these do not replace.
    assert len(read_campaign(copy).all_sample_rows()) >= sum(used.values()) + strings
    return copy


def _unlike(row, string, sample):
    """Return the row of another sample; every third one has failed."""
    row = row.copy()
    row["string"], row["sample"], row["crc"] = string, sample, 0
    if sample % 3 == 2:
        row["state"], row["reason"] = 2, 3
    for name in ("mean_radius_ratio", "largest_residual", "energy_error"):
        if name in row.dtype.names:
            row[name] = 3.0 * np.abs(row[name]) + 0.5
    row["particles"], row["collisions"] = 1, 0
    return row


def run(*words):
    """Run `agglom`, which must succeed; what it prints."""
    done = CliRunner().invoke(main, [str(word) for word in words])
    assert done.exit_code == 0, done.output
    return done.stdout


def answers(path, folder, *asked):
    """Return all analyses of a file, with the words that ask for sets or posteriors, as texts."""
    folder.mkdir()
    said = json.loads(run("report", path, "--json", *asked))
    best = json.loads(run("report", path, "--json"))
    file = read_campaign(path)
    string = best["best"][0]["string"]
    found = {
        "asked": _without(said),
        "best": _without(best),
        "warnings": run_warnings(file),
        "failures": failure_lines(file)[:1],
        "ledger": [[c.cell(row) for c in LEDGER_COLUMNS[:5]] for row in ledger_table(file).rows],
        "radii": completed_samples(file, string)["sample"].tolist(),
        "running": running_estimate(file, string).objective.tobytes().hex(),
    }
    arrays = sample_arrays(file)
    timed = [name for name in arrays.variables if name.removeprefix(PREFIX) in TIMES]
    arrays = arrays.drop_vars(timed)
    for name in arrays.variables:
        values = arrays[name].to_numpy()
        texts = values.dtype == object
        found[f"arrays.{name}"] = values.tolist() if texts else values.tobytes().hex()
    run("export", path, "--csv", folder / "csv")
    for table in sorted((folder / "csv").iterdir()):
        frame = pd.read_csv(table, dtype=str)
        kept = [name for name in frame if name.split(" ")[0] not in TIMES]
        found[f"csv.{table.name}"] = frame[kept].to_csv()
    return {name: repr(value) for name, value in found.items()}


def _without(entries):
    """Return JSON without what says how the run went."""
    if isinstance(entries, list):
        return [_without(each) for each in entries]
    if isinstance(entries, dict):
        return {k: _without(v) for k, v in entries.items() if k not in OF_THE_RUN}
    return entries
