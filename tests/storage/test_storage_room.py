"""How large a campaign file is made, and what may be asked for."""

import numpy as np
import pytest
from campaign_runs import write_campaign
from storage_rows import GENERATIONS, MAX_SAMPLES, POPULATION, STRINGS, make

from agglom_mpi.config.loading import load_campaign
from agglom_mpi.config.yaml_source import CampaignError
from agglom_mpi.storage import room
from agglom_mpi.storage.files import CheckedFile
from agglom_mpi.storage.room import TableSizes, check_room, size_text, table_sizes

SIZES = TableSizes(STRINGS, MAX_SAMPLES, GENERATIONS, POPULATION)
HDF5_BYTES = 200_000
"""More than what HDF5 itself, and the campaign's text, take in a small file."""


@pytest.mark.parametrize(
    "more",
    [{}, {"fresh": 30}, {"grains": 50, "final_particles": True}, {"grains": 50, "frames": 7}],
)
def test_the_size_of_a_file_is_known_before_it_is_made(tmp_path, more):
    path = make(tmp_path / "a.h5", text="a: 1", **more)
    expected = SIZES._replace(**more).file_bytes()
    assert expected <= path.stat().st_size < expected + HDF5_BYTES


def test_sizes_are_written_with_three_digits():
    assert [size_text(n) for n in (4_561_234, 2_300_000_000_000)] == ["4.56 MB", "2.3 TB"]


def refusal(campaign, present=0):
    with pytest.raises(CampaignError) as caught:
        check_room(campaign, table_sizes(campaign), present)
    [problem] = caught.value.problems
    return problem


def test_too_many_generations_are_refused_where_they_stand(tmp_path):
    path = write_campaign(tmp_path / "a.yaml", generations=10**6, population=10**4)
    campaign = load_campaign(path)
    problem = refusal(campaign)
    line = 1 + campaign.text.splitlines().index("  generations: 1000000")
    assert (problem.field, problem.line) == ("stopping.generations", line)
    fits = campaign.with_generations(1000)
    check_room(fits, table_sizes(fits))


def test_a_file_that_is_there_already_is_as_large_as_it_is(tmp_path):
    campaign = load_campaign(
        write_campaign(tmp_path / "a.yaml", generations=10**6, population=10**4)
    )
    check_room(campaign, table_sizes(campaign), present=table_sizes(campaign).file_bytes())


def test_where_one_generation_is_too_large_something_else_is_named(tmp_path, monkeypatch):
    monkeypatch.setattr(room, "MAX_FILE_BYTES", 10**6)
    campaign = load_campaign(write_campaign(tmp_path / "a.yaml", generations=1))
    assert refusal(campaign).field == "ensemble"
    text = campaign.text + "\noutput: {final_particles: true}\n"
    (tmp_path / "b.yaml").write_text(text)
    assert refusal(load_campaign(tmp_path / "b.yaml")).field == "output.final_particles"


def test_a_place_that_the_file_system_cannot_have_is_a_failed_write(tmp_path):
    with CheckedFile(tmp_path / "a") as file:
        file.seek(-1)
        file.write(b"lost")
        with pytest.raises(OSError, match="File too large"):
            file.check()
    assert (tmp_path / "a").read_bytes() == b""


def test_the_schema_tells_the_size_of_rows_as_numpy_has_it():
    for table in SIZES._replace(grains=9, final_particles=True, frames=2).tables():
        assert room._row_bytes(table) == np.dtype(table.dtype).itemsize + table.final
