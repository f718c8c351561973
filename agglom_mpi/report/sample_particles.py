"""Particles of recorded samples, as they are stored or resimulated."""

from types import SimpleNamespace
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from agglom_mpi.analysis.estimates import objective_of
from agglom_mpi.analysis.resimulation import is_same
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
    stored, radii = _stored_radii(data, string, rows[:MAX_SAMPLES])
    if radii:
        return _pooled(data, stored, radii, f"as stored of {kind} samples")
    count = _affordable_samples(data, rows, seconds)
    if not count:
        reason = "particles are not stored, and to simulate again takes too long"
        return _mean_radii(data, rows, reason)
    try:
        radii, same = _resimulated_radii(data, string, rows[:count])
    except (CampaignError, RuntimeError) as error:
        return _mean_radii(data, rows, f"samples cannot be simulated again ({error})")
    source = "simulated again, identical to the recorded ones"
    if not same:
        source = "simulated again by other sources, not identical to the recorded ones"
    return _pooled(data, rows[:count], radii, f"{kind} samples, {source}")


def _stored_radii(
    data: CampaignData, string: int, rows: np.ndarray
) -> tuple[np.ndarray, list[Floats]]:
    """Return the rows whose particles are stored, and the radii b/b0 of each."""
    if not data.attributes.get("final_particles"):
        return rows[:0], []
    found = [data.particles.final(string, int(sample)) for sample in rows["sample"]]
    first = grain_radius(*_scene_and_value(data, string))
    is_stored = np.array([particles is not None for particles in found], bool)
    return rows[is_stored], [each.radii / first for each in found if each is not None]


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


def _resimulated_radii(
    data: CampaignData, string: int, rows: np.ndarray
) -> tuple[list[Floats], bool]:
    """Return the radii of resimulated samples, and whether all equal the recorded ones."""
    from agglom_mpi.verbs.simulate import simulate

    campaign = recorded_campaign(data)
    parameters, first = data.parameters[string], campaign.first_sample(string)
    outcomes = [simulate(campaign, parameters, first + int(row["sample"])) for row in rows]
    same = all(
        is_same(row, each.record, data.sizes.version)
        for row, each in zip(rows, outcomes, strict=True)
    )
    return [outcome.radii for outcome in outcomes], same


def _pooled(
    data: CampaignData, rows: np.ndarray, radii: list[Floats], source: str
) -> RadiusDistribution:
    """Return the radii of the particles of samples, one array each, as one distribution."""
    return _distribution(data, rows, np.concatenate(radii), False, source)


def _mean_radii(data: CampaignData, rows: np.ndarray, source: str) -> RadiusDistribution:
    """Return the mean radii of samples; the moments are still those of the particles."""
    return _distribution(data, rows, rows["mean_radius_ratio"].copy(), True, source)


def _distribution(
    data: CampaignData, rows: np.ndarray, values: Floats, of_means: bool, source: str
) -> RadiusDistribution:
    pool = PooledMoments()
    for summary in summaries(rows):
        pool.add(summary.particles, summary.mean_radius_ratio, summary.central_moments)
    mean = float(rows["mean_radius_ratio"].mean())
    string = int(rows["string"][0])
    return RadiusDistribution(
        string, values, len(rows), of_means, mean, pool.central, source, target_ratio(data)
    )


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
        frames = _resimulated_frames(data, string, sample)
    except (CampaignError, RuntimeError) as error:
        raise FramesUnavailableError(str(error)) from error
    width = half_width(*_scene_and_value(data, string))
    return SampleFrames(string, sample, frames, "simulated again", width)


def _resimulated_frames(data: CampaignData, string: int, sample: int) -> Frames:
    from agglom_mpi.verbs.simulate import simulate

    campaign, parameters = recorded_campaign(data), data.parameters[string]
    end = end_time(*campaign.at(parameters))
    number = campaign.first_sample(string) + sample
    outcome = simulate(campaign, parameters, number, frames=end * np.array(FRAME_TIMES))
    assert outcome.frames is not None
    return outcome.frames


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
