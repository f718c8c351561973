"""Emulators of made-up data that are linear in the searched variables, so that all is known."""

import dataclasses

import numpy as np
from measured_runs import write_measured

from agglom_mpi.config.loading import load_campaign
from agglom_mpi.inference.data_emulator import EmulatedData
from agglom_mpi.inference.searched_box import SearchedBox
from agglom_mpi.inference.stored_samples import StoredSamples, StringValues
from agglom_mpi.measurements.datum import Datum

STRINGS, SAMPLES = 60, 6
NOISE = 0.02
"""Standard deviation of a value of one sample."""


def measurements(values, errors):
    """Return a datum for each value, which stands for a mean diameter."""
    pairs = zip(values, errors, strict=True)
    return [
        Datum.of_value("mean_diameter", value, error, name=f"number {i}")
        for i, (value, error) in enumerate(pairs)
    ]


def correlated(data, correlations):
    """Return data whose errors have correlations, shape (values, values)."""
    found = []
    for datum, row in zip(data, correlations, strict=True):
        pairs = tuple(zip(found, map(float, row), strict=False))
        found.append(dataclasses.replace(datum, correlations=pairs))
    return found


def linear_emulator(folder, slopes, data, noise=NOISE, failing=None, seed=1):
    """Return the emulator of values that are 1 + slopes @ u, with u the place in the unit square.

    `slopes` has the shape (values, 2). Strings where `failing(u)` is true have failed.
    """
    box = SearchedBox(load_campaign(write_measured(folder)))
    random = np.random.default_rng(seed)
    places = random.random((STRINGS, 2))
    failed = np.zeros(STRINGS, bool) if failing is None else failing(places)
    tried = box.space.from_unit(places)
    which = np.repeat(np.flatnonzero(~failed), SAMPLES)
    values = 1.0 + places[which] @ np.asarray(slopes).T
    values = values + noise * random.normal(size=values.shape)
    stored = StoredSamples(tried[which], np.empty(len(which)), tried, failed)
    return EmulatedData(box, data, StringValues(tried[which], values), stored)
