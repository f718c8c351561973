"""Whether measurements leave the share of the box that was expected of them.

`python tests/benchmarks/bench_next_measurement.py FILE.h5 [MEASUREMENTS]`, a campaign with data.
The measurements that are ranked first and last are made that many times: strings are drawn from the
posterior, and a measurement of each from an emulator of all data together with the new one, given
the old ones. The new posterior has this emulator, too: nothing is shared with the prediction but
the samples of the file and the posterior that the strings are drawn from.

Of jobs/measured/measured.yaml, shares of the box in 1e-3 (20 measurements each; the posterior as it
is fills 1.090; both ratios differ from 1 by more than the Monte-Carlo errors, as the emulators do):

    temperature at the end, again    expected 0.511 ± 0.002, found 0.498 ± 0.004, ratio 0.974
    d10 by number at the end, ± 5 %  expected 1.090 ± 0.001, found 1.118 ± 0.001, ratio 1.026
"""

import math
import sys
from pathlib import Path

import numpy as np

sys.path.append(str(Path(__file__).parents[1] / "helpers"))

from direct_simulations import drawn_posterior, with_measurement, with_values

from agglom_mpi.emulation.blas_threads import single_threaded
from agglom_mpi.inference.data_posterior import data_posterior
from agglom_mpi.storage.reader import read_campaign

MEASUREMENTS = 20


def simulated(emulated, strings, random):
    """Return simulated values of the last datum at strings, given the others, (n, q)."""
    away, covariances = emulated.framed_residuals(strings)
    new, rows = emulated.frame.columns[-1], emulated.frame.rows[-1]
    old = slice(0, new.start)
    basis = emulated.frame.basis[rows, new]
    found = []
    for residual, covariance in zip(away, covariances, strict=True):
        gain = np.linalg.solve(covariance[old, old], covariance[old, new]).T
        rest = covariance[new, new] - gain @ covariance[old, new]
        expected = gain @ residual[old]
        drawn = random.multivariate_normal(expected, rest)
        # A residual is the datum less the prediction: that of the placeholder is known.
        found.append(emulated.data[-1].values + (drawn - residual[new]) @ np.linalg.pinv(basis))
    return np.array(found)


@single_threaded
def volumes_after(posterior, each, count, random):
    """Return the volumes of the posteriors after simulated measurements, (count,)."""
    emulated = with_measurement(posterior, each)
    chosen = random.choice(len(posterior.weights), count, p=posterior.weights)
    values = simulated(emulated, posterior.strings[chosen], random)
    found = []
    for value in values:
        measured = np.append(posterior.of.frame.measured, value)
        found.append(drawn_posterior(with_values(emulated, measured)).volume)
        print(".", end="", flush=True)
    print()
    return np.array(found)


def main(path, count=MEASUREMENTS):
    """Print the expected volumes and those after simulated measurements."""
    posterior = data_posterior(read_campaign(path))
    found = posterior.next_measurements()
    print(f"posterior as it is: {found.volume:.4g} of the box")
    random = np.random.default_rng(20)
    for each in (found.ranked[0], found.ranked[-1]):
        volumes = volumes_after(posterior, each, count, random)
        mean, error = volumes.mean(), volumes.std(ddof=1) / math.sqrt(count)
        print(
            f"{each.name}, {each.error_text}: expected {each.after.value:.4g} ± "
            f"{each.after.error:.1g}, found {mean:.4g} ± {error:.1g}, "
            f"ratio {mean / each.after.value:.3f}"
        )


if __name__ == "__main__":
    main(sys.argv[1], *map(int, sys.argv[2:]))
