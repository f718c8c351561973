"""Particles at the end of samples and on the way: stored bit for bit, and whole or absent."""

import time

import h5py
import numpy as np
import pytest
from storage_rows import LOWER, MAX_SAMPLES, STRINGS, make, put_strings, sample_rows, table_room

from agglom_mpi.analysis.file_check import check_file
from agglom_mpi.campaign_file import open_campaign
from agglom_mpi.config.describe import FINAL_BYTES, FRAME_BYTES
from agglom_mpi.outcome import FinalParticles
from agglom_mpi.simulation.frames import new_frames
from agglom_mpi.storage import create
from agglom_mpi.storage import row_buffer as buffer
from agglom_mpi.storage.compact import CopyCounts, write_compact
from agglom_mpi.storage.create import enlarge_campaign_file
from agglom_mpi.storage.particle_tables import (
    final_particles_schema,
    final_row,
    frame_rows,
    frames_schema,
)
from agglom_mpi.storage.reader import read_campaign
from agglom_mpi.storage.rows import Rows
from agglom_mpi.storage.table import Table
from agglom_mpi.storage.verify import verify_rows
from agglom_mpi.storage.writer import CampaignWriter
from agglom_mpi.variables import TEN

GRAINS, COUNT = 20, 4
WIDE = {"grains": GRAINS, "final_particles": True, "frames": 3 * COUNT}
ODD = [0.1, 1 / 3, 5e-324, -0.0, 1.7976931348623157e308, np.inf, np.nan]
"""Numbers that only a copy of their bits keeps."""


@pytest.fixture
def path(tmp_path):
    return make(tmp_path / "grains.h5", **WIDE)


def left(string, sample):
    """Return how many particles are left, from 1 to all."""
    return 1 + (7 * string + sample) % GRAINS


def final(string, sample):
    """Return final particles that no other sample has."""
    chance, n = np.random.default_rng([string, sample]), left(string, sample)
    radii = chance.random(n)
    radii[: len(ODD)] = ODD[:n]
    return FinalParticles(radii, chance.random(n), chance.integers(1, 9, n), chance.random(n))


def pictures(string, sample):
    """Return frames with fewer and fewer particles."""
    chance = np.random.default_rng([string, sample, 1])
    frames = new_frames(np.linspace(0.0, chance.random(), COUNT), GRAINS)
    for frame, n in enumerate((GRAINS, left(string, sample), 1, 0)):
        frames.particles[frame] = n
        for name in ("positions", "velocities", "radii", "masses", "temperatures"):
            getattr(frames, name)[frame, :n] = chance.random(getattr(frames, name)[frame, :n].shape)
        frames.labels[frame, :n] = chance.permutation(GRAINS)[:n]
        frames.grains[frame, :n] = chance.integers(1, 9, n)
    return frames


def samples_and_finals(string, first, count):
    rows = sample_rows(string, first, count)
    rows["particles"] = [left(string, sample) for sample in rows["sample"]]
    finals = [final_row(string, int(j), final(string, int(j)), GRAINS) for j in rows["sample"]]
    return rows, np.concatenate(finals)


@pytest.fixture
def filled(path):
    """Return a file with samples, their particles, and pictures of two samples."""
    with CampaignWriter(path) as writer:
        put_strings(writer, 0, 6)
        for string in (0, 2, 5):
            writer.put_samples(*samples_and_finals(string, string, 8))
        writer.frames.put(0, frame_rows(5, 1, pictures(5, 1)))
        for frame in reversed(range(COUNT)):
            writer.frames.put(COUNT + frame, frame_rows(2, 0, pictures(2, 0))[frame : frame + 1])
    return path


def same(found, wanted):
    """Compare named tuples of arrays bit for bit."""
    assert type(found) is type(wanted)
    for name, array in wanted._asdict().items():
        stored = getattr(found, name)
        if array is None:  # spins of grains that have none
            assert stored is None
            continue
        assert (stored.dtype, stored.shape) == (array.dtype, array.shape), name
        assert stored.tobytes() == array.tobytes(), name
    return True


def damage(path, table, place, column="temperature"):
    """Change a final row, but not its checksum."""
    with h5py.File(path, "r+") as file:
        row = file[table][place]
        row[column][0] += 1
        file[table][place] = row


def test_what_is_written_is_read_back_bit_for_bit(filled):
    file = open_campaign(filled)
    for string in (0, 2, 5):
        for sample in range(string, string + 8):
            assert same(file.final_particles(string, sample), final(string, sample))
    assert file.framed() == [(5, 1), (2, 0)]
    for pair in file.framed():
        assert same(file.frames(*pair), pictures(*pair))


@pytest.fixture
def cold(tmp_path):
    """Return a file of a scene without temperature, whose kernels keep 0 K."""
    lower = np.where(np.array(TEN.names) == "temperature", np.nan, LOWER)
    path = make(tmp_path / "cold.h5", lower=lower, **WIDE)
    kept, shown = final(0, 0), pictures(0, 0)
    rows = sample_rows(0, 0, 1)
    rows["mean_temperature"] = 0.0
    with CampaignWriter(path) as writer:
        put_strings(writer, 0, 1)
        zero = kept._replace(temperatures=np.zeros_like(kept.temperatures))
        writer.put_samples(rows, final_row(0, 0, zero, GRAINS))
        present = np.isfinite(shown.temperatures)
        frames = shown._replace(temperatures=np.where(present, 0.0, np.nan))
        writer.frames.put(0, frame_rows(0, 0, frames))
    return path


def test_a_scene_without_temperature_has_none_in_tables_and_particles(cold):
    file, data = open_campaign(cold), read_campaign(cold)
    assert not data.has_temperature
    assert np.isnan(file.samples["mean_temperature"]).all()
    kept, shown = data.particles.final(0, 0), data.particles.frames(0, 0)
    assert np.isnan(kept.temperatures).all()
    assert kept.radii.tobytes() == final(0, 0).radii.tobytes()
    assert not shown.has_temperature
    assert data.all_sample_rows()["mean_temperature"].tolist() == [0.0]  # as it is stored


def test_a_scene_with_a_temperature_keeps_it(filled):
    file = open_campaign(filled)
    assert read_campaign(filled).has_temperature
    assert np.isfinite(file.samples["mean_temperature"]).all()


@pytest.mark.parametrize("numbers", [(1.5, 0), (0, 2.0), ("1", 0), (True, 0), (None, 0)])
def test_numbers_of_strings_and_samples_are_whole(filled, numbers):
    file = open_campaign(filled)
    for read in (file.final_particles, file.frames):
        with pytest.raises(ValueError, match=r"(string|sample): is .*; must be a whole number"):
            read(*numbers)
    assert file.final_particles(np.int64(0), np.int32(0)) is not None


def test_what_is_not_there_is_none(filled, tmp_path):
    file = open_campaign(filled)
    assert file.final_particles(0, 8) is file.final_particles(1, 0) is None
    # Not the particles of sample 0 of string 5 + 1, or 7 of string 0, whose rows these would be.
    assert file.final_particles(5 - 1, MAX_SAMPLES + 5) is None
    assert file.final_particles(1, 7 - MAX_SAMPLES) is None
    assert file.final_particles(STRINGS, 0) is file.final_particles(-1, MAX_SAMPLES) is None
    assert file.frames(5, 0) is None
    bare = open_campaign(make(tmp_path / "bare.h5"))
    assert (bare.final_particles(0, 0), bare.framed(), bare.frames(0, 0)) == (None, [], None)
    with h5py.File(bare.path) as opened:
        assert {"final_particles", "frames"}.isdisjoint(opened)


def test_places_of_particles_that_are_no_more_are_empty(filled):
    with h5py.File(filled) as file:
        row = file["final_particles"][2 * MAX_SAMPLES + 3]
        frames = file["frames"][COUNT : 2 * COUNT]
    n = left(2, 3)
    assert (row["string"], row["sample"], row["particles"]) == (2, 3, n)
    assert 0 < n < GRAINS
    for name in ("radius", "mass", "temperature"):
        assert np.isnan(row[name][n:]).all()
    assert not row["grains"][n:].any()
    assert frames["frame"].tolist() == list(range(COUNT))
    for picture in frames:
        n = picture["particles"]
        assert (picture["label"][n:] == -1).all()
        assert not picture["grains"][n:].any()
        for name in ("position", "velocity", "radius", "mass", "temperature"):
            assert np.isnan(picture[name][n:]).all()


@pytest.mark.parametrize("layout", [final_particles_schema, frames_schema])
def test_particles_that_spin_have_three_numbers_more(layout):
    smooth, spinning = (layout(GRAINS, spins) for spins in (False, True))
    assert spinning.dtype.names == (*smooth.dtype.names[:-1], "spin", "crc")
    assert spinning.dtype.itemsize - smooth.dtype.itemsize == 24 * GRAINS


@pytest.mark.parametrize(
    ("layout", "bytes_of_a_grain"),
    [(final_particles_schema, FINAL_BYTES), (frames_schema, FRAME_BYTES)],
)
def test_the_size_that_is_announced_is_that_of_a_row(layout, bytes_of_a_grain):
    sizes = [layout(grains).dtype.itemsize for grains in (0, 100, 1000)]
    assert [size - sizes[0] for size in sizes] == [
        0,
        100 * bytes_of_a_grain,
        1000 * bytes_of_a_grain,
    ]
    assert sizes[0] < 50


def failing(monkeypatch, table):
    """Make writes to a dataset fail; return what undoes it."""
    write = Rows.write

    def refuse(self, first, rows):
        if self.name == f"/{table}":
            raise OSError(28, "No space left on device")
        write(self, first, rows)

    monkeypatch.setattr(Rows, "write", refuse)
    return lambda: monkeypatch.setattr(Rows, "write", write)


@pytest.mark.parametrize(
    ("table", "particles"),
    [
        ("final_particles", False),
        ("final_particles_done", False),
        ("samples", True),
        ("samples_done", True),
    ],
)
def test_no_sample_is_final_before_its_particles(path, monkeypatch, table, particles):
    file = open_campaign(path)
    with CampaignWriter(path) as writer:
        put_strings(writer, 0, 1)
        writer.put_samples(*samples_and_finals(0, 0, 3))
        mend = failing(monkeypatch, table)
        with pytest.raises(OSError, match="No space left"):
            writer.flush()
        assert len(read_campaign(path).all_sample_rows()) == 0
        assert (file.final_particles(0, 2) is not None) == particles
        assert verify_rows(path).faults == []
        mend()
        writer.flush()
        assert len(read_campaign(path).all_sample_rows()) == 3
        assert same(file.final_particles(0, 2), final(0, 2))


def test_particles_may_come_ahead_of_their_samples(path):
    file = open_campaign(path)
    rows, finals = samples_and_finals(0, 0, 3)
    with CampaignWriter(path) as writer:
        put_strings(writer, 0, 1)
        writer.put_samples(rows[:0], finals)
        writer.put_samples(rows)
        writer.flush()
    assert [same(file.final_particles(0, j), final(0, j)) for j in range(3)] == [True] * 3


def test_particles_that_are_written_again_are_absent_until_they_are_whole(path, monkeypatch):
    file, (rows, finals) = open_campaign(path), samples_and_finals(0, 0, 3)
    with CampaignWriter(path) as writer:
        put_strings(writer, 0, 1)
        writer.put_samples(rows[:0], finals)
    assert file.final_particles(0, 2) is not None
    with CampaignWriter(path) as writer:
        writer.put_samples(rows, finals)
        mend = failing(monkeypatch, "final_particles")
        with pytest.raises(OSError, match="No space left"):
            writer.flush()
        assert file.final_particles(0, 2) is None, "a half-written row would count as damage"
        mend()
    assert same(file.final_particles(0, 2), final(0, 2))


def test_of_two_rows_for_one_sample_the_particles_are_those_of_the_one_that_stays(path):
    rows, finals = samples_and_finals(0, 0, 2)
    late = rows.copy(), finals.copy()
    late[0]["particles"], late[1]["particles"] = 1, 1
    with CampaignWriter(path) as writer:
        put_strings(writer, 0, 1)
        writer.put_samples(rows, finals)
        writer.put_samples(*late)
    assert same(open_campaign(path).final_particles(0, 1), final(0, 1))
    assert verify_rows(path).faults == []


def test_rows_beyond_the_room_are_refused(path):
    rows, finals = samples_and_finals(0, 0, 1)
    finals["sample"] = MAX_SAMPLES
    with CampaignWriter(path) as writer, pytest.raises(IndexError, match="room for 0 to 99"):
        writer.put_samples(rows, finals)
    with CampaignWriter(path) as writer, pytest.raises(IndexError, match="/frames"):
        writer.frames.put(2 * COUNT + 1, frame_rows(0, 0, pictures(0, 0)))


def test_large_rows_wait_for_fewer_others(path, monkeypatch):
    size = final_particles_schema(GRAINS).dtype.itemsize
    monkeypatch.setattr(buffer, "FLUSH_BYTES", 5 * size + 1)
    file = open_campaign(path)
    with CampaignWriter(path) as writer:
        put_strings(writer, 0, 1)
        for sample in range(4):
            writer.put_samples(*samples_and_finals(0, sample, 1))
        assert len(read_campaign(path).all_sample_rows()) == 0
        writer.put_samples(*samples_and_finals(0, 4, 1))
        assert len(read_campaign(path).all_sample_rows()) == 5
        assert same(file.final_particles(0, 4), final(0, 4))


def test_a_torn_row_of_final_particles_is_absent_and_a_fault(filled):
    damage(filled, "final_particles", 2 * MAX_SAMPLES + 3)
    file = open_campaign(filled)
    assert file.final_particles(2, 3) is None
    assert same(file.final_particles(2, 4), final(2, 4))
    report = verify_rows(filled)
    assert report.faults == ["final_particles: sample 3 of string 2 with a wrong checksum"]
    assert report.losses == []
    assert report.counts == {"final_particles": 23, "frames": 2 * COUNT}


def test_a_torn_picture_is_absent_and_taken_again(filled):
    damage(filled, "frames", COUNT + 2)
    file = open_campaign(filled)
    kept = pictures(2, 0).times[[0, 1, 3]]
    assert file.frames(2, 0).times.tobytes() == kept.tobytes()
    report = verify_rows(filled)
    assert report.losses == [f"frames: {COUNT + 2} with a wrong checksum"]
    assert report.faults == []
    with CampaignWriter(filled) as writer:
        assert set(writer.frames.keys()) == set(range(2 * COUNT)) - {COUNT + 2}
        writer.frames.put(COUNT, frame_rows(2, 0, pictures(2, 0)))
    assert same(file.frames(2, 0), pictures(2, 0))
    assert verify_rows(filled).losses == []


def test_particles_of_another_sample_or_number_are_a_fault(filled):
    other = final_row(2, 4, final(2, 3), GRAINS)
    few = final_row(0, 6, FinalParticles(*(array[:1] for array in final(0, 6)[:4])), GRAINS)
    with CampaignWriter(filled) as writer:
        finals = writer.samples._finals.table
        finals.write(2 * MAX_SAMPLES + 3, other)
        finals.write(6, few)
    [fault] = verify_rows(filled).faults
    said = "final_particles: wrong content in "
    assert fault == said + "sample 6 of string 0, sample 3 of string 2"


def test_a_picture_in_another_place_and_a_missing_one_are_found(filled):
    with CampaignWriter(filled) as writer:
        writer.set_status("finished")
    with h5py.File(filled, "r+") as file:
        table = Table(file, "frames", filled)
        rows = table.rows.read(0, 1)
        rows["frame"] += 1
        table.write(0, rows)
        last = table.end() - 1
        file["frames_done"][last] = 0
    text, code = check_file(str(filled))
    assert code == 1
    assert "frames: wrong content in 0" in text
    assert f"frames: {last} absent, though others of their samples are there" in text


def test_a_picture_that_is_being_replaced_is_no_damage(filled, monkeypatch):
    with CampaignWriter(filled) as writer:
        rows = Rows(writer._file["frames"], filled)
        half = rows.read(0, 1)
        half["time"] = 7.0
        rows.write(0, half)
        new = frame_rows(0, 3, pictures(0, 3))
        monkeypatch.setattr(time, "sleep", lambda seconds: writer.frames.put(0, new))
        report = verify_rows(filled)
    assert (report.losses, report.faults) == ([], [])


def test_pictures_are_dropped_and_replaced(filled):
    file = open_campaign(filled)
    with CampaignWriter(filled) as writer:
        assert writer.frames.keys()[COUNT + 1] == (2, 0, 1)
        writer.frames.forget()
        assert writer.frames.keys() == {}
        assert (file.framed(), file.frames(5, 1)) == ([], None)
        writer.frames.put(0, frame_rows(0, 3, pictures(0, 3)))
    assert file.framed() == [(0, 3)]
    assert same(file.frames(0, 3), pictures(0, 3))


def test_a_picture_that_is_half_written_is_absent(filled, monkeypatch):
    file = open_campaign(filled)
    with CampaignWriter(filled) as writer:
        mend = failing(monkeypatch, "frames")
        with pytest.raises(OSError, match="No space left"):
            writer.frames.put(0, frame_rows(0, 3, pictures(0, 3)))
        mend()
    assert file.framed() == [(2, 0)]
    assert verify_rows(filled).losses == []


def rows_of(path):
    file = read_campaign(path)
    return file.string_rows().tobytes() + file.all_sample_rows().tobytes()


def test_tables_are_added_later_and_every_row_is_kept(tmp_path, monkeypatch):
    monkeypatch.setattr(create, "_COPY_BYTES", 400)
    path = make(tmp_path / "grains.h5")
    with CampaignWriter(path) as writer:
        put_strings(writer, 0, 6)
        writer.put_samples(sample_rows(3, 0, 8))
    before = rows_of(path)
    steps = [
        {"grains": GRAINS, "final_particles": True},
        WIDE,
        {},
        WIDE | {"frames": 5 * COUNT},
    ]
    for step, more in enumerate(steps):
        enlarge_campaign_file(path, table_room(STRINGS + step // 3, 1, **more))
        assert rows_of(path) == before
        with CampaignWriter(path) as writer:
            writer.put_samples(*samples_and_finals(4, step, 1))
            if step:
                writer.frames.put(step * COUNT - COUNT, frame_rows(4, step, pictures(4, step)))
        before = rows_of(path)
    file = read_campaign(path)
    assert file.particles.final(3, 0) is None
    assert all(same(file.particles.final(4, step), final(4, step)) for step in range(4))
    assert file.particles.framed() == [(4, 1), (4, 2), (4, 3)]
    assert all(
        same(file.particles.frames(*pair), pictures(*pair)) for pair in file.particles.framed()
    )
    assert file.attributes["frames"] == 5 * COUNT
    assert verify_rows(path).faults == []


def test_a_compact_copy_keeps_them_and_is_as_short_as_what_it_holds(filled, tmp_path):
    copy = tmp_path / "copy.h5"
    assert write_compact(filled, copy) == CopyCounts(strings=6, samples=24, damaged=0)
    file = read_campaign(copy)
    for string in (0, 2, 5):
        for sample in range(string, string + 8):
            assert same(file.particles.final(string, sample), final(string, sample))
    assert file.particles.framed() == [(5, 1), (2, 0)]
    assert all(
        same(file.particles.frames(*pair), pictures(*pair)) for pair in file.particles.framed()
    )
    assert file.particles.final(STRINGS - 1, 0) is None
    with h5py.File(copy) as opened:
        lengths = {name: len(dataset) for name, dataset in opened.items()}
    assert lengths["final_particles"] == lengths["final_particles_done"] == 6 * MAX_SAMPLES
    assert lengths["frames"] == lengths["frames_done"] == file.attributes["frames"] == 2 * COUNT
    report = verify_rows(copy)
    assert (report.losses, report.faults) == ([], [])
    assert write_compact(copy, tmp_path / "again.h5") == CopyCounts(
        strings=6, samples=24, damaged=0
    )


def test_a_copy_without_any_of_them_can_be_read(path, tmp_path):
    write_compact(path, tmp_path / "copy.h5")
    file = open_campaign(tmp_path / "copy.h5")
    assert (file.framed(), file.final_particles(0, 0)) == ([], None)
    assert verify_rows(file.path).faults == []


def test_a_copy_has_no_particles_of_samples_that_it_lacks(path, tmp_path):
    _, finals = samples_and_finals(0, 0, 3)
    with CampaignWriter(path) as writer:
        put_strings(writer, 0, 1)
        writer.put_samples(sample_rows(0, 0, 0), finals)
    assert open_campaign(path).final_particles(0, 1) is not None
    write_compact(path, tmp_path / "copy.h5")
    assert open_campaign(tmp_path / "copy.h5").final_particles(0, 1) is None
