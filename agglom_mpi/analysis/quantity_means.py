"""Means over a string's samples: quantities of functions and of spins, volume fractions drawn.

Where grains differ in size, a sample draws its sizes first of all from its own random stream, so
that they are drawn here again and nothing is simulated. Large grains jam, so that the completed
samples may fill less of the box than all of them.
"""

from collections.abc import Iterable
from typing import TYPE_CHECKING, Any, Final, NamedTuple

import numpy as np

from agglom_mpi.analysis.estimates import completed_rows
from agglom_mpi.outcome import COMPLETED, FailureReason, quantity_columns
from agglom_mpi.statistics import Floats, MeanEstimate, mean_of

if TYPE_CHECKING:
    from agglom_mpi.storage.reader import CampaignData

MEASURED_ON: Final = "as searched", "re-estimate"
"""Labels of the two means: over the samples that decisions rest on, and over fresh ones."""
MAX_GRAINS: Final = 2_000_000
"""Grains of a string whose sizes are drawn again, the first samples of it; a tenth of a second."""


def quantity_means(data: "CampaignData", string: int) -> dict[str, tuple[MeanEstimate, ...]]:
    """Return the mean of each quantity over the samples used of a string, and the fresh ones.

    Failed samples are left out. The dictionary is empty where there are no quantities.
    """
    names = list(data.sizes.quantities)
    if not names:
        return {}
    used, fresh = (completed_rows(data, string, fresh) for fresh in (False, True))
    return {name: (mean_of(used[name]), mean_of(fresh[name])) for name in names}


def as_entries(data: "CampaignData", string: int) -> dict[str, Any]:
    """Return the `quantities` of a string by name, for JSON: means, standard errors and units."""
    return {
        name: {
            "mean": used.value,
            "standard_error": used.error,
            "estimate": fresh.value,
            "estimate_standard_error": fresh.error,
            "unit": data.sizes.quantities[name],
        }
        for name, (used, fresh) in quantity_means(data, string).items()
    }


def quantity_table(
    data: "CampaignData", strings: Iterable[int], fresh: bool
) -> dict[str, tuple[Floats, str]]:
    """Return columns of means and standard errors for n strings: values, (n,), and unit, by name.

    Parameters
    ----------
    data
    strings
    fresh
        Whether the means are over fresh samples, and not over those that results rest on.
    """
    found = [quantity_means(data, string) for string in strings] if data.sizes.quantities else []
    table: dict[str, tuple[Floats, str]] = {}
    for name, unit in data.sizes.quantities.items():
        means = [each[name][int(fresh)] for each in found]
        own = quantity_columns(name)[2 * fresh :]
        table[own[0]] = np.array([mean.value for mean in means], np.float64), unit
        table[own[1]] = np.array([mean.error for mean in means], np.float64), unit
    return table


class DrawnFraction(NamedTuple):
    """Volume fractions of the samples of a string.

    Attributes
    ----------
    completed : MeanEstimate
        Of the completed samples, at most as many as have `MAX_GRAINS`.
    wanted : float
        That of the string.
    jammed : int
        Number of samples that found no place for their grains.
    """

    completed: MeanEstimate
    wanted: float
    jammed: int

    def as_dict(self) -> dict[str, float | int | None]:
        """Return plain values for JSON."""
        mean, error, _ = self.completed
        numbers = {"standard_error": error, "wanted": self.wanted, "jammed": self.jammed}
        return {"mean": mean, **numbers}


def drawn_fraction(file: "CampaignData", string: int) -> DrawnFraction | None:
    """Return the volume fractions of a string's samples; None if grains are equal, or none is done.

    Used samples count, and fresh ones, too.
    """
    if not any(key.startswith("scene.sizes.") for key in file.identity):
        return None
    # Imported here: a file of equal grains is read without what reads campaigns.
    from agglom_mpi.physics.size_distributions import draw_radii
    from agglom_mpi.storage.recorded_campaign import recorded_campaign
    from agglom_mpi.variables import volume_fraction
    from agglom_mpi.verbs.simulate import random_numbers

    campaign, rows = recorded_campaign(file), file.counted_samples
    rows = rows[rows["string"] == string]
    done = rows["sample"][rows["state"] == COMPLETED].tolist()
    if campaign.scene.size_law is None or not done:
        return None
    parameters = file.parameters[string]
    section, values = campaign.at(parameters)
    wanted, share = volume_fraction(values["size_ratio"], section.third_moment), []
    count, first = campaign.scene.particles, campaign.first_sample(string)
    for sample in done[: max(2, MAX_GRAINS // count)]:
        random = random_numbers(campaign, parameters, first + sample)
        cubes = float(np.mean(draw_radii(section.size_law, random, count) ** 3))  # ⟨b³⟩/⟨b⟩³
        share.append(wanted / section.third_moment * cubes)
    jammed = int((rows["reason"] == FailureReason.PLACEMENT_JAMMED).sum())
    return DrawnFraction(mean_of(share), wanted, jammed)
