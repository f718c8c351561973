"""Frames as a VTKHDF file: VTK reads back what was written, bit for bit."""

import os

import h5py
import numpy as np
import pytest
from vtk_files import assert_shows

from agglom_mpi.report.paraview import POINT_DATA, write_vtkhdf
from agglom_mpi.simulation.frames import new_frames


def some_frames(counts, grains, spins=False):
    """Return frames with `counts` particles, whose values all differ."""
    random = np.random.default_rng(len(counts))
    frames = new_frames(np.cumsum(random.random(len(counts))), grains, spins)
    for f, count in enumerate(counts):
        frames.particles[f] = count
        frames.labels[f, :count] = random.permutation(10 * grains)[:count]
        frames.grains[f, :count] = random.integers(1, 9, count)
        for values in (frames.positions, frames.velocities, frames.radii, frames.temperatures):
            values[f, :count] = random.normal(size=values[f, :count].shape)
        if frames.spins is not None:
            frames.spins[f, :count] = random.normal(size=(count, 3))
    return frames


@pytest.mark.parametrize(
    ("counts", "grains"),
    [([7, 5, 5, 1, 3, 7], 7), ([4], 4), ([1, 1], 1), ([9000, 20_000, 8192], 20_000)],
    ids=["bonds and breaks", "a single frame", "a single grain", "several chunks"],
)
def test_vtk_reads_back_every_frame_with_the_particles_there_are(tmp_path, counts, grains):
    frames = some_frames(counts, grains)
    write_vtkhdf(tmp_path / "out.vtkhdf", frames, "some")
    assert_shows(tmp_path / "out.vtkhdf", frames)


def test_a_file_says_its_version_its_units_and_what_it_shows(tmp_path):
    frames = some_frames([3, 2], 4, spins=True)
    write_vtkhdf(tmp_path / "out.vtkhdf", frames, "Growth: string 1, sample 0")
    with h5py.File(tmp_path / "out.vtkhdf") as file:
        root = file["VTKHDF"]
        assert file.attrs["title"] == "Growth: string 1, sample 0"
        assert root.attrs["Version"].tolist() == [2, 0]
        kind = root.attrs.get_id("Type")
        assert (kind.shape, kind.dtype) == ((), np.dtype("S8"))  # of fixed length, as VTK wants it
        assert root.attrs["Type"] == b"PolyData"
        assert {"Vertices", "Lines", "Polygons", "Strips", "PointData", "Steps"} < root.keys()
        units = {name: root["PointData"][name].attrs["unit"] for name in root["PointData"]}
        assert units == {name: unit for name, (_, unit) in POINT_DATA.items()}
        assert root["Points"].attrs["unit"] == "m"
        shown = frames.spins[np.arange(4) < frames.particles[:, None]]
        np.testing.assert_array_equal(root["PointData/spin"], shown)
        assert root["Steps/PointDataOffsets"].keys() == units.keys()


def test_particles_without_temperature_have_no_array_of_it(tmp_path):
    frames = some_frames([3, 2], 4)
    frames.temperatures[:] = np.nan
    write_vtkhdf(tmp_path / "out.vtkhdf", frames, "some")
    with h5py.File(tmp_path / "out.vtkhdf") as file:
        root = file["VTKHDF"]
        assert set(root["PointData"]) == {"radius", "velocity", "grains", "label"}
        assert set(root["Steps/PointDataOffsets"]) == set(root["PointData"])


def test_no_file_is_overwritten_and_none_left_half_written(tmp_path, monkeypatch):
    path = tmp_path / "out.vtkhdf"
    path.write_text("precious")
    with pytest.raises(FileExistsError):
        write_vtkhdf(path, some_frames([2], 2), "")
    assert path.read_text() == "precious"
    path.unlink()

    def fail(*arguments):
        raise KeyboardInterrupt

    monkeypatch.setattr("agglom_mpi.report.paraview._store_steps", fail)
    with pytest.raises(KeyboardInterrupt):
        write_vtkhdf(path, some_frames([2], 2), "")
    assert os.listdir(tmp_path) == []
