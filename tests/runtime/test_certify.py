import numpy as np
import pytest

from agglom_mpi import open_campaign
from agglom_mpi.analysis.file_check import check_file
from agglom_mpi.inference.certificate import certificate_of
from agglom_mpi.runtime.certify import CertifyOptions, certify
from agglom_mpi.storage.reader import read_campaign

GIVEN = {
    "claim": "0.9",
    "confidence": "95%",
    "tolerance": "10%",
    "strings": 31,
    "max_samples": 160,
    "seed": 1,
    "robust": {},
    "quiet": True,
}
"""A wide tolerance, which needs few samples."""


def options(path, **changed):
    return CertifyOptions(**{"file": str(path), **GIVEN, **changed})


@pytest.fixture
def copied(three, tmp_path):
    """Return the path of a copy of the campaign file, beside which nothing lies."""
    path = tmp_path / "three.h5"
    path.write_bytes(three.path.read_bytes())
    return path


@pytest.fixture(scope="module")
def certified(three, tmp_path_factory):
    """Return the path of a campaign file with a finished certificate."""
    path = tmp_path_factory.mktemp("certified") / "three.h5"
    path.write_bytes(three.path.read_bytes())
    assert certify(options(path), None) == 0
    return path


def test_a_certificate_counts_the_strings_of_its_file(certified):
    found = certificate_of(read_campaign(certified))
    assert found.finished
    assert found.right + found.wrong + found.undecided == 31
    assert found.right >= 25
    file = read_campaign(found.path)
    assert found.samples == sum(file.samples_used.values()) == len(file.all_sample_rows())
    assert set(file.samples_used.values()) <= {40, 80, 160}
    assert check_file(found.path)[1] == 0


def test_strings_are_drawn_from_the_part_that_is_claimed(certified):
    found = open_campaign(certified).feasible_set("10%")
    certificate = found.certificate
    strings = np.array(list(read_campaign(certificate.path).parameters.values()))
    probability = found.emulated.probability(strings)
    assert probability.min() >= certificate.part.least_probability > 0.05
    inside = found.points.probability >= certificate.part.least_probability
    assert certificate.part.share == pytest.approx(found.points.weights[inside].sum())
    assert len(np.unique(strings, axis=0)) == 31


def test_samples_are_those_of_streams_that_the_campaign_never_used(certified):
    campaign, fresh = (
        read_campaign(certified),
        read_campaign(certified.parent / "three.certificate.h5"),
    )
    assert campaign.identity["seed"] != fresh.identity["seed"] == fresh.attributes["seed"]
    known = set(campaign.all_sample_rows()["mean_radius_ratio"].tolist())
    rows = fresh.all_sample_rows()
    assert len({x for x in rows["mean_radius_ratio"].tolist() if x > 1.0} & known) < 10
