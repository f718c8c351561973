"""Sets of stopping rules that studies vary and figures compare."""

from collections.abc import Callable
from functools import partial
from typing import Final

from agglom_mpi.search.stopping import Moments, StandardError, StoppingRule, SuccessiveDifference

STUDIED_RULES: Final[tuple[tuple[str, Callable[..., StoppingRule]], ...]] = (
    ("successive difference, mean radius", partial(SuccessiveDifference, quantity="mean_radius")),
    ("successive difference, objective", SuccessiveDifference),
    *((f"moments 1 to {order}", partial(Moments, order=order)) for order in (2, 3, 4)),
    ("standard error", StandardError),
)
"""Rules whose tolerance `agglom accuracy` varies: name, and the rule of a `tolerance` and of
`max_samples`."""

UNLIMITED_SAMPLES: Final = 10**6
"""Maximum number of samples where a rule alone is to end them."""


def compared_rules() -> dict[str, StoppingRule]:
    """Return the rules that the figure of a campaign's ensembles compares, by label.

    They are the papers' own with their tolerances, and two that look at more.
    """
    most = UNLIMITED_SAMPLES
    return {
        "mean radius within 1e-5 [A 27]": SuccessiveDifference(
            tolerance=1e-5, quantity="mean_radius", max_samples=most
        ),
        "objective within 5e-4 [B 8.1]": SuccessiveDifference(tolerance=5e-4, max_samples=most),
        "four moments within 1e-3 [A 25]": Moments(tolerance=1e-3, order=4, max_samples=most),
        "half-width ≤ 0.01": StandardError(tolerance=0.01, max_samples=most),
    }
