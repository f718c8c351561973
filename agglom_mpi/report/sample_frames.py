"""Frames of one sample, stored or simulated again, and the figures of them."""

from collections.abc import Iterator
from types import SimpleNamespace
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from agglom_mpi.analysis.resimulation import is_same, recorded_campaign
from agglom_mpi.config.yaml_source import CampaignError
from agglom_mpi.outcome import COMPLETED, summaries
from agglom_mpi.physics.scales import end_time, grain_radius
from agglom_mpi.report.figures.cloud import cloud_size, draw_cloud
from agglom_mpi.report.figures.radii import Radii
from agglom_mpi.report.picture import Picture
from agglom_mpi.simulation.frames import Frames
from agglom_mpi.statistics import PooledMoments
from agglom_mpi.storage.reader import CampaignData
from agglom_mpi.variables import NAMES

Floats = NDArray[np.float64]


SECONDS: Final = 1.0
"""Processor time that samples simulated again may take, by what they took when they were run."""

SAMPLES: Final = 200
"""Samples whose particles are shown at most."""

FRAMES: Final = 6
"""Pictures of a sample that are shown."""

TIMES: Final = (0.0, 0.01, 0.03, 0.1, 0.3, 1.0)
"""When they are taken, if they are not stored, over the end time: particles bond early."""


GRAINS: Final = 200_000
"""Grains of a sample beyond which it is not simulated again."""


class SampleFrames(NamedTuple):
    """Pictures of one sample, and where they are from."""

    string: int
    sample: int
    frames: Frames
    source: str


def chosen(data: CampaignData, string: int) -> np.ndarray:
    """Rows of the completed samples that stand for a string: fresh ones if there are any."""
    rows = data.sample_rows(string)
    rows = rows[rows["state"] == COMPLETED]
    fresh = rows[rows["sample"] >= data.fresh_from]
    return fresh if len(fresh) else rows


def all_stored(data: CampaignData) -> bool:
    """Whether both final particles and pictures are stored, so that nothing is simulated again."""
    return bool(data.attributes.get("final_particles") and data.framed())


def final_radii(data: CampaignData, string: int, seconds: float = SECONDS) -> Radii | None:
    """Radii b/b0 of the particles that samples of a string end with; None without a sample.

    They are read where they are stored. Otherwise as many samples are simulated again as take
    so many seconds, and if that is none, the mean radii of all samples take their place.
    """
    rows = chosen(data, string)
    if not len(rows):
        return None
    kind = "fresh" if rows["sample"][0] >= data.fresh_from else "all"
    kept, parts = _stored(data, string, rows[:SAMPLES])
    if parts:
        return _pooled(string, kept, parts, f"as stored of {kind} samples")
    affordable = _affordable(data, rows, seconds)
    if affordable:
        again = rows[:affordable]
        try:
            parts, same = _simulated(data, string, again)
        except (CampaignError, RuntimeError) as error:
            return _means(string, rows, f"samples cannot be simulated again ({error})")
        said = "simulated again, identical to the recorded ones"
        if not same:
            said = "simulated again by other sources, not identical to the recorded ones"
        return _pooled(string, again, parts, f"{kind} samples, {said}")
    return _means(string, rows, "particles are not stored, and to simulate again takes too long")


def _stored(data: CampaignData, string: int, rows: np.ndarray) -> tuple[np.ndarray, list[Floats]]:
    """Those rows whose particles are stored, and the radii b/b0 of each."""
    if not data.attributes.get("final_particles"):
        return rows[:0], []
    found = [data.final_particles(string, int(sample)) for sample in rows["sample"]]
    scene = SimpleNamespace(
        particles=data.identity["scene.particles"],
        half_width=data.identity["scene.half_width"],
    )
    first = grain_radius(scene, {"size_ratio": float(data.values([string], "size_ratio")[0])})
    there = np.array([particles is not None for particles in found], bool)
    return rows[there], [each.radii / first for each in found if each is not None]


def _affordable(data: CampaignData, rows: np.ndarray, seconds: float) -> int:
    """How many samples may be simulated again."""
    if int(data.identity["scene.particles"]) > GRAINS:
        return 0
    count = seconds / max(float(rows["seconds"].mean()), 1e-9)
    return int(min(len(rows), SAMPLES, count))


def _simulated(data: CampaignData, string: int, rows: np.ndarray) -> tuple[list[Floats], bool]:
    """Simulate samples again; the radii of each, and whether all are those that are recorded."""
    campaign = recorded_campaign(data)
    parameters, first = data.parameters[string], campaign.first_sample(string)
    outcomes = [campaign.simulate(parameters, first + int(row["sample"])) for row in rows]
    same = all(
        is_same(row, each.record, data.format_version)
        for row, each in zip(rows, outcomes, strict=True)
    )
    return [outcome.radii for outcome in outcomes], same


def _pooled(string: int, rows: np.ndarray, parts: list[Floats], source: str) -> Radii:
    return Radii(string, np.concatenate(parts), len(parts), False, *_moments(rows), source)


def _means(string: int, rows: np.ndarray, why: str) -> Radii:
    """Mean radii of samples; the moments are still those of the particles, as recorded."""
    return Radii(string, rows["mean_radius_ratio"].copy(), len(rows), True, *_moments(rows), why)


def _moments(rows: np.ndarray) -> tuple[float, tuple[float, float, float]]:
    """Mean over samples, and central moments 2, 3, 4 of all their particles, as recorded."""
    pool = PooledMoments()
    for outcome in summaries(rows):
        pool.add(outcome.particles, outcome.mean_radius_ratio, outcome.central_moments)
    return float(rows["mean_radius_ratio"].mean()), pool.central


def frames_of(data: CampaignData, string: int, seconds: float = SECONDS) -> SampleFrames | None:
    """Pictures of a sample of a string, stored ones if there are any; None if too dear."""
    stored = [pair for pair in data.framed() if pair[0] == string]
    stored = stored or data.framed()
    for pair in stored:
        frames = data.frames(*pair)
        if frames is not None and frames.particles.max(initial=0) > 0:
            return SampleFrames(*pair, frames, "as stored")
    rows = chosen(data, string)
    if not len(rows) or not _affordable(data, rows, seconds):
        return None
    sample = int(rows["sample"][0])
    campaign = recorded_campaign(data)
    number = campaign.first_sample(string) + sample
    parameters = data.parameters[string]
    end = end_time(campaign.scene, dict(zip(NAMES, parameters.tolist(), strict=True)))
    outcome = campaign.simulate(parameters, number, frames=end * np.array(TIMES))
    if outcome.frames is None:
        return None
    return SampleFrames(string, sample, outcome.frames, "simulated again")


def cloud_pictures(data: CampaignData, found: SampleFrames | None) -> Iterator[Picture]:
    """Yield the picture of a cloud of particles, if there is a film."""
    if found is None:
        return
    at = informative_frames(found.frames)
    half_width = float(data.identity["scene.half_width"])

    def draw(figure: object) -> None:
        draw_frames(figure, found, half_width)

    yield Picture(
        "cloud",
        f"Particles of sample {found.sample} of string {found.string} at successive times, "
        f"{found.source} ([B] fig. 5). The box is seen obliquely, spheres are to scale.",
        draw,
        cloud_size(len(at)),
    )


def draw_frames(figure: object, found: SampleFrames, half_width: float) -> NDArray[np.object_]:
    """Draw some frames of a film into a figure, box from −D to D in m, and return the axes."""
    frames, at = found.frames, informative_frames(found.frames)
    counts = [int(frames.particles[f]) for f in at]
    pairs = list(zip(at, counts, strict=True))
    return draw_cloud(
        figure,  # type: ignore[arg-type]
        frames.times[at],
        [frames.positions[f, :n] for f, n in pairs],
        [frames.radii[f, :n] for f, n in pairs],
        half_width,
        [frames.temperatures[f, :n] for f, n in pairs],
    )


def informative_frames(frames: Frames) -> list[int]:
    """Places of at most six frames that have particles, the first and the last included.

    Particles bond early: the frames are those whose numbers of particles are nearest to a geometric
    series, and then the earliest.
    """
    there = np.flatnonzero(frames.particles > 0)
    counts = np.log(frames.particles[there])
    picks = {0, len(there) - 1}
    for wanted in np.linspace(counts[0], counts[-1], FRAMES):
        picks.add(int(np.argmin(np.abs(counts - wanted))))
    picks |= set([i for i in range(len(there)) if i not in picks][: FRAMES - len(picks)])
    return there[sorted(picks)].tolist()
