"""The sections of the report, in their order."""

from collections.abc import Iterator, Mapping

import numpy as np
from numpy.typing import NDArray

from agglom_mpi.accuracy.box import box
from agglom_mpi.accuracy.cooling import cooling
from agglom_mpi.accuracy.ensemble import ensemble
from agglom_mpi.accuracy.extremes import extremes
from agglom_mpi.accuracy.few_body import few_body
from agglom_mpi.accuracy.impact_solver import impact_solver
from agglom_mpi.accuracy.inversion import inversion
from agglom_mpi.accuracy.plan import Plan
from agglom_mpi.accuracy.section import Section
from agglom_mpi.accuracy.statistics import completed
from agglom_mpi.accuracy.time_integration import EVENT, time_integration
from agglom_mpi.accuracy.whole_method import whole_method

Samples = Mapping[str, NDArray[np.void]]


def scene_sections(plan: Plan, samples: Samples) -> Iterator[Section]:
    """Error against run time of one scene, knob by knob.

    The quick study leaves out what would compile further kernels.
    """
    campaign = plan.campaign
    assert campaign is not None
    yield time_integration(campaign, plan.parameters, samples, plan.quick)
    if not plan.quick:
        yield few_body()
    yield impact_solver(plan.quick)
    yield cooling(campaign.scene.build(plan.parameters), plan.quick)
    if not plan.quick:
        yield whole_method(campaign, samples)
    yield ensemble(campaign, completed(samples[EVENT]), plan.quick)
    yield box(campaign, plan.parameters, samples, plan.quick)
    if plan.history is not None:
        yield inversion(plan.history, samples)


def extreme_sections(plan: Plan, samples: Samples) -> Iterator[Section]:
    """Stiff and extreme scenes."""
    yield extremes(plan.scenes, samples)
