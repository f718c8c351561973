"""The figures of one run show what the run was, and can be read."""

from itertools import combinations

import numpy as np
import pytest
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from vtk_files import assert_shows

from agglom_mpi import load_campaign
from agglom_mpi.report.figures.evolution import draw_evolution, evolution, evolution_size
from agglom_mpi.report.simulate import FILES, MAX_PANELS, panel_frames, write_frames
from agglom_mpi.simulation.frames import new_frames
from agglom_mpi.verbs.simulate import simulate


@pytest.fixture(scope="module")
def campaign():
    from campaign_runs import QUICKSTART

    return load_campaign(QUICKSTART)


@pytest.fixture(scope="module")
def outcome(campaign):
    return simulate(campaign, {}, 3, frames=50)


def two_and_one():
    """Return frames of two grains and of what they become, in a flow of (100, 0, 0) m/s."""
    frames = new_frames(np.array([0.0, 1.0]), 2)
    frames.particles[:] = 2, 1
    frames.radii[0], frames.radii[1, 0] = 0.5, 0.8
    frames.masses[0], frames.masses[1, 0] = (1.0, 3.0), 4.0
    frames.velocities[0] = (100.0, 3.0, 0.0), (100.0, -1.0, 0.0)
    frames.velocities[1, 0] = 1e-12, 100.0, -7.7
    frames.temperatures[0], frames.temperatures[1, 0] = (300.0, 340.0), 331.0
    frames.grains[0], frames.grains[1, 0] = (1, 3), 4
    frames.positions[0], frames.positions[1, 0] = ((0.0, 0.0, 0.0), (1.0, 1.0, 1.0)), 0.5
    return frames


def test_an_evolution_is_in_the_frame_of_the_mean_flow_and_by_mass():
    run = evolution(two_and_one())
    assert run["particles"].tolist() == [2, 1]
    assert run["mean_radius_ratio"].tolist() == [1.0, 1.6]
    # Σ m|v − V|² is 1 · 3² + 3 · 1², and V is along x.
    np.testing.assert_allclose(run["granular_temperature"], [12.0 / (3.0 * 4.0), 0.0], rtol=1e-15)
    np.testing.assert_allclose(run["mean_temperature"], [330.0, 331.0], rtol=1e-15)


def test_grains_that_spin_have_a_panel_of_their_rotation():
    frames = two_and_one()
    spins = np.full((2, 2, 3), np.nan)
    spins[0], spins[1, 0] = ((0.0, 3.0, 0.0), (0.0, 0.0, 1.0)), (0.0, 3.0, 4.0)
    run = evolution(frames._replace(spins=spins))
    # Σ (2/5) m b² ω², over 3 Σ m.
    wanted = [0.4 * 0.25 * (1.0 * 9.0 + 3.0 * 1.0) / 12.0, 0.4 * 4.0 * 0.64 * 25.0 / 12.0]
    np.testing.assert_allclose(run["rotational_temperature"], wanted, rtol=1e-15)
    figure, axes = drawn(run)
    labels = [" ".join(ax.get_ylabel().split()) for ax in axes]
    assert labels[2:4] == ["granular temperature (m²/s²)", "rotational temperature (m²/s²)"]
    assert_legible(figure, axes)


def test_an_evolution_ends_with_what_the_record_says(outcome):
    run = evolution(outcome.frames)
    assert run["particles"][[0, -1]].tolist() == [100, outcome.particles]
    assert run["mean_radius_ratio"][0] == pytest.approx(1.0, rel=1e-14)
    assert run["mean_radius_ratio"][-1] == pytest.approx(outcome.mean_radius_ratio, rel=1e-13)
    end = float(outcome.record["mean_temperature"])
    assert run["mean_temperature"][-1] == pytest.approx(end, rel=1e-13)
    # Impacts only ever take energy from the fluctuation, and nothing breaks in this scene.
    assert np.all(np.diff(run["granular_temperature"]) <= 1e-13 * run["granular_temperature"][0])
    assert np.all(np.diff(run["particles"]) <= 0)


def drawn(run):
    """Return the figure of an evolution, and its axes."""
    figure = Figure(figsize=evolution_size(run), layout="constrained")
    FigureCanvasAgg(figure)
    axes = draw_evolution(figure, run)
    figure.canvas.draw()
    return figure, axes


def assert_legible(figure, axes):
    """Check that labels lie in the figure, and none on another."""
    renderer = figure.canvas.get_renderer()
    texts = [text for ax in axes for text in (ax.xaxis.label, ax.yaxis.label)]
    for ax in axes:
        low, high = ax.get_ylim()
        ticks = [tick for tick in ax.yaxis.get_major_ticks() if low <= tick.get_loc() <= high]
        texts += [tick.label1 for tick in ticks]
    low, high = axes[-1].get_xlim()
    ticks = [tick for tick in axes[-1].xaxis.get_major_ticks() if low <= tick.get_loc() <= high]
    texts += [tick.label1 for tick in ticks]
    boxes = {text.get_text(): text.get_window_extent(renderer) for text in texts if text.get_text()}
    for box in boxes.values():
        assert figure.bbox.x0 <= box.x0 < box.x1 <= figure.bbox.x1
        assert figure.bbox.y0 <= box.y0 < box.y1 <= figure.bbox.y1
    found = [text.get_window_extent(renderer) for text in texts if text.get_text()]
    assert len(found) > 10
    assert not any(one.overlaps(other) for one, other in combinations(found, 2))


def test_all_panels_have_units_and_can_be_read(outcome):
    figure, axes = drawn(evolution(outcome.frames))
    labels = [" ".join(ax.get_ylabel().split()) for ax in axes]
    assert labels == [
        "particles",
        "mean radius b/b⁰",
        "granular temperature (m²/s²)",
        "mean temperature (K)",
    ]
    assert axes[-1].get_xlabel() == "time (ms)"
    assert axes[0].lines[0].get_xdata()[-1] == pytest.approx(1e3 * outcome.record["end_time"])
    assert [ax.get_yscale() for ax in axes] == ["linear", "linear", "log", "linear"]
    assert_legible(figure, axes)


@pytest.mark.parametrize(
    ("last", "unit", "shown"),
    [(3e-9, "ns", 3.0), (0.999, "ms", 999.0), (1.0, "s", 1.0), (1e5, "s", 1e5), (0.0, "s", 0.0)],
)
def test_times_have_a_suitable_unit(last, unit, shown):
    figure, axes = drawn(evolution(two_and_one()._replace(times=np.array([0.0, last]))))
    assert axes[-1].get_xlabel() == f"time ({unit})"
    assert axes[-1].lines[0].get_xdata()[-1] == pytest.approx(shown)
    assert_legible(figure, axes)


def test_a_temperature_that_nothing_changes_has_no_panel():
    frames = two_and_one()
    frames.temperatures[0] = frames.temperatures[1, 0] = 300.0
    frames.velocities[0] = 0.0
    figure, axes = drawn(evolution(frames))
    assert len(axes) == 3
    assert_legible(figure, axes)


def test_a_cloud_shows_all_frames_or_some_from_first_to_last():
    for count in range(1, MAX_PANELS + 1):
        assert panel_frames(count) == list(range(count))
    for count in (MAX_PANELS + 1, 100, 12345):
        shown = panel_frames(count)
        assert len(shown) == MAX_PANELS
        assert (shown[0], shown[-1]) == (0, count - 1)
        assert np.ptp(np.diff(shown)) <= 1


def test_all_files_of_a_run_are_written(campaign, outcome, tmp_path):
    half = campaign.scene.half_width
    written = write_frames(tmp_path / "new" / "run", outcome.frames, half, "Growth: sample 3")
    folder = tmp_path / "new" / "run"
    assert written == [str(folder / name) for name in FILES]
    assert sorted(path.name for path in folder.iterdir()) == sorted(FILES)
    assert_shows(folder / "particles.vtkhdf", outcome.frames)
