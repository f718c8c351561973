"""Particles of recorded samples, as they are stored or resimulated."""

from types import SimpleNamespace
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from agglom_mpi.analysis.estimates import objective_of
from agglom_mpi.analysis.resimulation import is_same, simulated_again
from agglom_mpi.analysis.tables import time_on_free_core
from agglom_mpi.config.yaml_source import CampaignError
from agglom_mpi.outcome import COMPLETED, summaries
from agglom_mpi.physics.scales import end_time, grain_radius, half_width
from agglom_mpi.simulation.frames import Frames
from agglom_mpi.statistics import PooledMoments
from agglom_mpi.storage.reader import CampaignData
from agglom_mpi.storage.recorded_campaign import recorded_campaign

Floats = NDArray[np.float64]

RESIMULATION_SECONDS: Final = 1.0
"""Processor time for resimulating samples, estimated from the recorded times, s."""

MAX_SAMPLES: Final = 200
"""Samples whose particles are shown at most."""

FRAMES: Final = 6
"""Frames of a sample that are shown at most."""

FRAME_TIMES: Final = (0.0, 0.01, 0.03, 0.1, 0.3, 1.0)
"""Times of resimulated frames over the end time: particles bond early."""

MAX_GRAINS: Final = 200_000
"""Grains of a sample beyond which it is not resimulated."""


class FramesUnavailableError(ValueError):
    """No frames of a sample can be shown, with the reason in one line."""


class SampleFrames(NamedTuple):
    """Particle frames of one sample, stored or resimulated.

    Attributes
    ----------
    string, sample
    frames
    source
        Whether they are stored or resimulated, as text.
    half_width
        D of the box from −D to D, m.
    """

    string: int
    sample: int
    frames: Frames
    source: str
    half_width: float


class RadiusDistribution(NamedTuple):
    """Final radii b/b0 of the particles of a string.

    Attributes
    ----------
    string
    values
        Radii of the particles of all samples, shape (n,); if `of_means`, the mean of each sample.
    samples
        Number of samples.
    of_means
    mean, central
        Mean over samples of their mean radius, and central moments 2, 3, 4 over the particles of
        all samples [A 24].
    source
        Whether they are stored or resimulated, as text.
    target
        Mean ratio that the campaign asks for, if it asks for one.
    """

    string: int
    values: Floats
    samples: int
    of_means: bool
    mean: float
    central: tuple[float, float, float]
    source: str
    target: float | None = None

    @property
    def moments_text(self) -> str:
        """Mean, standard deviation, skewness and kurtosis [A 29], to be printed."""
        second, third, fourth = self.central
        words = f"mean {self.mean:.3f}, standard deviation {np.sqrt(second):.3f}"
        if second <= 0.0:
            return words
        return f"{words}\nskewness {third / second**1.5:.2f}, kurtosis {fourth / second**2:.2f}"


def target_ratio(data: CampaignData) -> float | None:
    """Return the mean radius ratio that a campaign asks for; None if it asks for none."""
    objective = objective_of(data)
    wanted = objective.wanted_growth if objective.is_magnitude else None
    return None if wanted is None else wanted[1]


def completed_samples(data: CampaignData, string: int) -> np.ndarray:
    """Return the rows of the completed samples of a string: the fresh ones if there are any."""
    rows = data.counted(data.sample_rows(string))
    rows = rows[rows["state"] == COMPLETED]
    fresh = rows[rows["sample"] >= data.fresh_from]
    return fresh if len(fresh) else rows


def all_stored(data: CampaignData) -> bool:
    """Return whether final particles and frames are stored, so that nothing is resimulated."""
    return bool(data.attributes.get("final_particles") and data.particles.framed())


def final_radii(
    data: CampaignData, string: int, seconds: float = RESIMULATION_SECONDS
) -> RadiusDistribution | None:
    """Return the final radii b/b0 of a string; None if it has no completed sample.

    They are read where they are stored, and else of resimulated samples. Where no sample can be
    resimulated, the recorded mean radii of all samples take their place.

    Parameters
    ----------
    data
    string
    seconds
        Processor time that resimulation may take, s.
    """
    rows = completed_samples(data, string)
    if not len(rows):
        return None
    kind = (
        "fresh" if rows["sample"][0] >= data.fresh_from else "all" if data.with_unused else "used"
    )
    if data.attributes.get("final_particles"):
        first = grain_radius(*_scene_and_value(data, string))
        found = [data.particles.final(string, int(k)) for k in rows["sample"][:MAX_SAMPLES]]
        if any(stored := [particles is not None for particles in found]):
            radii = [each.radii / first for each in found if each is not None]
            own = rows[: len(found)][np.array(stored)]
            return _distribution(data, own, radii, f"as stored of {kind} samples")
    count = _affordable_samples(data, rows, seconds)
    if not count:
        reason = "particles are not stored, and to simulate again takes too long"
        return _distribution(data, rows, None, reason)
    try:
        outcomes = [simulated_again(data, string, int(k)) for k in rows["sample"][:count]]
    except (CampaignError, RuntimeError) as error:
        return _distribution(data, rows, None, f"samples cannot be simulated again ({error})")
    radii, version = [outcome.radii for outcome in outcomes], data.sizes.version
    pairs = zip(rows[:count], outcomes, strict=True)
    same = all(is_same(row, outcome.record, version) for row, outcome in pairs)
    source = "simulated again, identical to the recorded ones"
    if not same:
        source = "simulated again by other sources, not identical to the recorded ones"
    return _distribution(data, rows[:count], radii, f"{kind} samples, {source}")


def _scene_and_value(data: CampaignData, string: int) -> tuple[Any, dict[str, float]]:
    """Return what `physics.scales` needs for the size of a string's grains and of its box."""
    if data.variables.further:
        return recorded_campaign(data).at(data.parameters[string])
    value = {"size_ratio": float(data.values([string], "size_ratio")[0])}
    if "scene.sizes.law" in data.identity:
        return recorded_campaign(data).scene, value
    scene = SimpleNamespace(
        particles=data.identity["scene.particles"],
        half_width=data.identity.get("scene.half_width"),
        diameter=data.identity.get("scene.grain_diameter"),
    )
    return scene, value


def _affordable_samples(data: CampaignData, rows: np.ndarray, seconds: float) -> int:
    """Return how many of these samples can be resimulated within some processor time, s."""
    if int(data.identity["scene.particles"]) > MAX_GRAINS:
        return 0
    count = seconds / max(float(time_on_free_core(rows).mean()), 1e-9)
    return int(min(len(rows), MAX_SAMPLES, count))


def _distribution(
    data: CampaignData, rows: np.ndarray, radii: list[Floats] | None, source: str
) -> RadiusDistribution:
    """Return the radii of the particles of samples, an array for each sample, as one distribution.

    None: the mean radius of each sample; the moments are still those of the particles.
    """
    pool = PooledMoments()
    for summary in summaries(rows):
        pool.add(summary.particles, summary.mean_radius_ratio, summary.central_moments)
    means, string = rows["mean_radius_ratio"].copy(), int(rows["string"][0])
    values = means if radii is None else np.concatenate(radii)
    numbers = len(rows), radii is None, float(means.mean()), pool.central
    return RadiusDistribution(string, values, *numbers, source, target_ratio(data))


def frames_of(
    data: CampaignData, string: int, seconds: float = RESIMULATION_SECONDS
) -> SampleFrames:
    """Return frames of a sample: stored ones, those of the string first, or resimulated ones.

    Parameters
    ----------
    data
    string
    seconds
        Processor time that resimulation may take, s.

    Raises
    ------
    FramesUnavailableError
        If none are stored, and no sample of the string can be resimulated.
    """
    stored = [pair for pair in data.particles.framed() if pair[0] == string]
    for pair in stored or data.particles.framed():
        frames = data.particles.frames(*pair)
        if frames is not None and frames.particles.max(initial=0) > 0:
            width = half_width(*_scene_and_value(data, pair[0]))
            return SampleFrames(*pair, frames, "as stored", width)
    rows = completed_samples(data, string)
    if not len(rows) or not _affordable_samples(data, rows, seconds):
        raise FramesUnavailableError(
            "frames are not stored, and to simulate a sample again takes too long or was not wanted"
        )
    sample = int(rows["sample"][0])
    try:
        end = end_time(*recorded_campaign(data).at(data.parameters[string]))
        outcome = simulated_again(data, string, sample, end * np.array(FRAME_TIMES))
    except (CampaignError, RuntimeError) as error:
        raise FramesUnavailableError(str(error)) from error
    assert outcome.frames is not None
    width = half_width(*_scene_and_value(data, string))
    return SampleFrames(string, sample, outcome.frames, "simulated again", width)


def informative_frames(frames: Frames) -> list[int]:
    """Return the indices of at most six frames that have particles, first and last included.

    Particles bond early: the frames are those whose numbers of particles are nearest to a geometric
    series, and then the earliest.
    """
    with_particles = np.flatnonzero(frames.particles > 0)
    counts = np.log(frames.particles[with_particles])
    picks = {0, len(with_particles) - 1}
    for wanted in np.linspace(counts[0], counts[-1], FRAMES):
        picks.add(int(np.argmin(np.abs(counts - wanted))))
    earliest = [i for i in range(len(with_particles)) if i not in picks]
    picks |= set(earliest[: FRAMES - len(picks)])
    return with_particles[sorted(picks)].tolist()
