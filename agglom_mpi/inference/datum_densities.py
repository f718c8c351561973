"""Density of each datum given the others, for any string: what leaving one out rests on.

Data have a covariance: by the errors of the measurement, and as the error of the emulator at a
string is shared. So the density of a datum is the conditional one. With the precision Q of all
data and their residuals r, it is normal with the precision Q_ii about the residual Q_ii⁻¹ (Q r)_i
(Bürkner, Gabry and Vehtari, Comput. Stat. 36, 2021, 1243).
"""

import math
from typing import Final, NamedTuple

import numpy as np

from agglom_mpi.emulation.gaussian_process import Floats
from agglom_mpi.formatting import value_with_prefix
from agglom_mpi.inference.data_emulator import EmulatedData

STRINGS_AT_ONCE: Final = 512
"""Number of strings whose covariances are inverted together."""


class DatumPoint(NamedTuple):
    """Data that are left out together: a datum, with all classes of a curve; one impact of a list.

    Attributes
    ----------
    name, experiment
        Of the datum or the impact, and in which it was measured; empty where there is none.
    columns
        Its directions among those of all data.
    """

    name: str
    experiment: str
    columns: slice


def datum_points(of: EmulatedData) -> tuple[list[DatumPoint], Floats]:
    """Return what is left out together, and the directions, (p, p), of all of it in the frame."""
    turned, found = of.frame.roots.copy(), list[DatumPoint]()
    own_basis = of.frame.basis @ of.frame.roots.T
    for datum, rows, columns in zip(of.data, of.frame.rows, of.frame.columns, strict=True):
        is_square = rows.stop - rows.start == columns.stop - columns.start
        if datum.impacts is None or not is_square:
            found.append(DatumPoint(datum.name, datum.experiment, columns))
            continue
        # Directions of a list mix its impacts; these are residuals over their standard errors.
        back = np.linalg.inv(own_basis[rows, columns]).T / datum.standard_errors[:, None]
        turned[columns] = back @ of.frame.roots[columns]
        for i, speed in enumerate(datum.impacts[:, 0].tolist()):
            place = columns.start + i
            name = f"{datum.name}: impact at {value_with_prefix(speed, 'm/s')}"
            found.append(DatumPoint(name, datum.experiment, slice(place, place + 1)))
    return found, turned


def conditional_densities(of: EmulatedData, strings: Floats) -> Floats:
    """Return the log-density of each `datum_points` given the others, for strings: (n, points).

    Densities are those of data in units of their errors.
    """
    points, turned = datum_points(of)
    found = np.empty((len(strings), len(points)))
    for start in range(0, len(strings), STRINGS_AT_ONCE):
        some = slice(start, start + STRINGS_AT_ONCE)
        away, covariances = of.framed_residuals(strings[some])
        precision = np.linalg.inv(turned @ covariances @ turned.T)
        pulls = np.einsum("nab,nb->na", precision, away @ turned.T)
        for i, (*_, own) in enumerate(points):
            block, pull = precision[:, own, own], pulls[:, own]
            squares = np.einsum("na,na->n", pull, np.linalg.solve(block, pull[..., None])[..., 0])
            _, logarithm = np.linalg.slogdet(block)
            rank = own.stop - own.start
            found[some, i] = 0.5 * (logarithm - squares - rank * math.log(2.0 * math.pi))
    return found
