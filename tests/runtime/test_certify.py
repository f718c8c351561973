import h5py
import numpy as np
import pytest
from campaign_runs import finish
from set_runs import three_variable_text
from storage_rows import put_status

from agglom_mpi import open_campaign
from agglom_mpi.analysis.file_check import check_file
from agglom_mpi.config.plan import CertificatePlan
from agglom_mpi.inference import feasible_set
from agglom_mpi.inference.certificate import certificate_of, certificate_path, samples_digest
from agglom_mpi.inference.certified_part import CertificateError
from agglom_mpi.inference.emulated_set import Wobble
from agglom_mpi.outcome import SampleSummary
from agglom_mpi.report.sections.section import plain_text
from agglom_mpi.report.set_summary import set_as_dict, set_text
from agglom_mpi.runtime import certify as certify_module
from agglom_mpi.runtime.certify import CertifyOptions, JudgedEnsemble, certify
from agglom_mpi.runtime.invert import InvertOptions, invert
from agglom_mpi.search.criteria import Band
from agglom_mpi.search.membership import MembershipTest
from agglom_mpi.storage.reader import read_campaign
from agglom_mpi.storage.recorded_campaign import recorded_campaign

GIVEN = {
    "claim": "0.9",
    "confidence": "95%",
    "tolerance": "10%",
    "strings": 31,
    "max_samples": 160,
}
"""A wide tolerance, which needs few samples."""


_KNOWN = {}


@pytest.fixture(autouse=True)
def remembered_sets(monkeypatch):
    """Compute each set once: copies of a file have the same."""
    made = certify_module.feasible_set

    def known(data, tolerance, robust):
        key = samples_digest(data), tolerance, *robust.items()
        if key not in _KNOWN:
            _KNOWN[key] = made(data, tolerance, robust)
        return _KNOWN[key]

    monkeypatch.setattr(certify_module, "feasible_set", known)


def options(path, **changed):
    given = {name: changed.pop(name) for name in CertificatePlan.model_fields if name in changed}
    return CertifyOptions(str(path), GIVEN | given, **{"quiet": True, **changed})


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


def test_a_stopped_certificate_goes_on_to_the_same_verdict(certified, copied):
    codes = [certify(options(copied, max_walltime=seconds), None) for seconds in (1e-3, 1e-3, None)]
    assert codes == [75, 75, 0]
    one, other = (certificate_of(read_campaign(path)) for path in (certified, copied))
    assert other._replace(path="") == one._replace(path="")
    tables = [read_campaign(each.path).rows("results").tolist() for each in (one, other)]
    assert tables[0] == tables[1]


def test_an_unfinished_certificate_proves_nothing(copied):
    assert certify(options(copied, max_walltime=1e-3), None) == 75
    found = certificate_of(read_campaign(copied))
    assert [found.finished, found.holds, found.refuted] == [False] * 3
    assert found.as_dict()["least_share"] is None
    [line] = found.lines()
    assert "not finished" in line


def test_a_set_that_the_emulator_has_wrong_is_refuted(copied, monkeypatch):
    """The emulator learns means of b/b0 that are too large by 0.35, so its set is another one."""
    stored = feasible_set.stored_samples

    def spoilt(data):
        found = stored(data)
        rows = found.rows.copy()
        rows["mean_radius_ratio"] += 0.35
        return found._replace(rows=rows)

    monkeypatch.setattr(feasible_set, "stored_samples", spoilt)
    monkeypatch.setattr(certify_module, "feasible_set", feasible_set.feasible_set)
    assert certify(options(copied), None) == 0
    found = certificate_of(read_campaign(copied))
    assert found.part.expected > 0.5
    assert found.refuted
    assert not found.holds
    assert found.wrong >= 20
    assert found.least_share < 0.3
    assert found.largest_share < 0.9


def test_wobbling_strings_are_judged_where_they_wobble_to(copied, monkeypatch):
    drawn = []
    wobbled = Wobble.drawn

    def seen(self, strings, random):
        drawn.append((strings, wobbled(self, strings, random)))
        return drawn[-1][1]

    monkeypatch.setattr(Wobble, "drawn", seen)
    assert certify(options(copied, robust={"relative_speed": "5%"}), None) == 0
    found = certificate_of(read_campaign(copied))
    assert found.plan.robust == {"relative_speed": 0.05}
    strings, judged = drawn[-1]
    stored = read_campaign(found.path).parameters
    assert np.array_equal([stored[i] for i in range(31)], judged, equal_nan=True)
    shifts = judged[:, 0] / strings[:, 0] - 1.0
    assert 0.03 < np.abs(shifts).max() <= 0.05
    assert np.array_equal(judged[:, 1:], strings[:, 1:], equal_nan=True)
    assert "relative_speed" in found.text
    assert found.as_dict()["counted"] == "pairs"
    assert len(found.lines()) == 6


def test_the_share_of_robust_strings_follows_from_that_of_right_pairs(certified):
    """If 0.95 of the pairs are right, 0.75 of the strings are for 0.8 of their deviations."""
    found = certificate_of(read_campaign(certified))
    assert found.as_dict()["counted"] == "strings"
    assert found.least_share_of_robust == found.least_share
    plan = found.plan.model_copy(update={"robust": {"hardness": 0.9}})
    for right in (31, 20, 0):
        pairs = found._replace(plan=plan, right=right, wrong=31 - right, undecided=0)
        markov = max(0.0, 1.0 - (1.0 - pairs.least_share) / 0.2)
        assert pairs.least_share_of_robust == pytest.approx(markov)
        assert pairs.as_dict()["least_share_of_robust"] == pairs.least_share_of_robust
        first, deviations, robust, *_ = pairs.lines()
        assert "pairs" in first
        assert "90 %" in deviations
        assert "80 %" in robust


def refused(capsys, path, **changed):
    """Return the one message with which a certificate is refused."""
    assert certify(options(path, quiet=False, **changed), None) == 2
    return capsys.readouterr().err.replace("\n", " ")


@pytest.mark.parametrize(
    ("changed", "said"),
    [
        ({"claim": "1.2"}, "claim: is 1.2"),
        ({"claim": "0"}, "claim: is 0"),
        ({"claim": "0.999999999"}, "claim: is 1"),
        ({"confidence": "much"}, "confidence: is 'much'"),
        ({"strings": 30}, "strings: is 30; must be at least 31"),
        ({"tolerance": "7"}, "tolerance: is 7"),
        ({"robust": {"density": "5%"}}, "robust.density: is no searched variable"),
        ({"robust": {"hardness": 2.0}}, "robust.hardness: is 2.0"),
    ],
)
def test_impossible_options_are_named(copied, capsys, changed, said):
    assert f"three.h5: {said}" in refused(capsys, copied, **changed)
    assert not certificate_path(copied).exists()


def test_a_set_is_tested_once(certified, capsys):
    assert "claim 0.9" in refused(capsys, certified, claim="0.8")
    assert "seed 2" in refused(capsys, certified, seed=2)


def test_a_certificate_of_other_samples_is_refused(certified, filled, tmp_path, capsys):
    path = tmp_path / "other.h5"
    path.write_bytes(filled.path.read_bytes())
    certificate_path(path).write_bytes(certificate_path(certified).read_bytes())
    assert "other samples" in refused(capsys, path, tolerance="25%")
    with pytest.raises(CertificateError, match="other samples"):
        certificate_of(read_campaign(path))
    certificate_path(path).write_bytes(path.read_bytes())
    assert "is no certificate" in refused(capsys, path, tolerance="25%")


def test_an_empty_set_has_no_certificate(filled, tmp_path, capsys):
    path = tmp_path / "filled.h5"
    path.write_bytes(filled.path.read_bytes())
    assert "empty" in refused(capsys, path, tolerance="5%")
    assert not certificate_path(path).exists()


def test_a_campaign_without_a_set_has_no_certificate(measured_file, capsys):
    assert "no feasible set" in refused(capsys, measured_file)


def test_an_unfinished_campaign_has_no_certificate(copied, capsys):
    with h5py.File(copied, "r+") as file:
        put_status(file, state=b"stopped")
    assert "is stopped; must be finished" in refused(capsys, copied)


def damage(path, table, row):
    """Change a number of a row, so that its checksum is wrong."""
    with h5py.File(path, "r+") as file:
        changed = file[table][row]
        name = "mean_radius_ratio" if table == "samples" else "hardness"
        changed[name] *= 1.01
        file[table][row] = changed


@pytest.mark.parametrize("table", ["samples", "strings"])
def test_a_damaged_campaign_has_no_certificate(copied, capsys, table):
    damage(copied, table, 0)
    assert read_campaign(copied).damaged == 1
    assert "1 damaged row" in refused(capsys, copied)
    assert not certificate_path(copied).exists()


def test_a_damaged_certificate_proves_nothing_until_the_same_command_mends_it(certified, tmp_path):
    path = tmp_path / "three.h5"
    path.write_bytes(certified.read_bytes())
    certificate_path(path).write_bytes(certificate_path(certified).read_bytes())
    damage(certificate_path(path), "samples", 0)
    with pytest.raises(CertificateError, match="1 damaged row"):
        certificate_of(read_campaign(path))
    assert certify(options(path), None) == 0
    mended = certificate_of(read_campaign(path))
    assert mended._replace(path="") == certificate_of(read_campaign(certified))._replace(path="")


def test_failures_end_no_string_between_looks(three):
    """Two of ten would end the ensemble of a search."""
    test = MembershipTest(Band("mean_radius_ratio", 1.9, 2.1, ""), (40, 80), np.empty((0, 1)))
    ensemble = JudgedEnsemble(test, recorded_campaign(read_campaign(three.path)).objective, 100)
    good = SampleSummary(True, 2.0, 50, (0.0, 0.0, 0.0), 1, 1, quantities=(2.0,))
    bad = good._replace(completed=False)
    for outcome in (bad, bad, *8 * [good]):
        ensemble.add(outcome)
    assert (ensemble.samples_used, ensemble.failed, ensemble.finished) == (10, 2, False)
    for _ in range(30):
        ensemble.add(good)
    assert (ensemble.finished, ensemble.max_samples) == (False, 80)
    for _ in range(40):
        ensemble.add(good)
    assert ensemble.finished


def test_a_certificate_is_shown_with_its_set_and_of_no_other_tolerance(certified):
    found = open_campaign(certified).feasible_set("10%")
    certificate = found.certificate
    assert certificate.lines()[0] in plain_text(set_text(found), 200)
    assert set_as_dict(found)["set"]["certificate"]["right"] == certificate.right
    assert open_campaign(certified).feasible_set("5%").certificate is None


@pytest.mark.slow
def test_a_function_of_the_user_runs_if_it_may_and_is_the_one_that_was_run(tmp_path, capsys):
    objective = "{law: function, call: 'worth:worth'}"
    text = three_variable_text(generations=4, objective=objective, final="none")
    (tmp_path / "three.yaml").write_text(text)
    source = "def worth(sample):\n    return abs(sample.mean_radius_ratio / 2.0 - 1.0)\n"
    (tmp_path / "worth.py").write_text(source)
    finish(tmp_path, "three.yaml", "--allow-code")
    path, given = tmp_path / "three.h5", {"tolerance": "0.2", "allow_code": True}
    assert "--allow-code" in refused(capsys, path, tolerance="0.2")
    assert certify(options(path, **given), None) == 0
    found = certificate_of(read_campaign(path, allow_code=True))
    assert found.finished
    assert found.right > 20
    (tmp_path / "worth.py").write_text(f"{source}\n\n")
    assert "worth.py was edited" in refused(capsys, path, **given)


def test_a_campaign_with_a_section_certify_is_certified_after_its_search(certified, copied, capsys):
    """The search is finished; the run stops within the certificate, and the next one ends it."""
    given = ", ".join(f"{name}: {value}" for name, value in GIVEN.items())
    path = copied.parent / "three.yaml"
    path.write_text(three_variable_text(final="none", certify=f"{{{given}}}"))
    codes = []
    for seconds in (1e-3, None, None):
        options = InvertOptions(str(path), str(copied), max_walltime=seconds)
        codes.append(invert(options, None))
    assert codes == [75, 0, 0]
    one, other = (certificate_of(read_campaign(each)) for each in (certified, copied))
    assert other._replace(path="") == one._replace(path="")
    assert one.lines()[0] in capsys.readouterr().out
    path.write_text(path.read_text().replace("claim: 0.9", "claim: 0.8"))
    assert invert(InvertOptions(str(path), str(copied)), None) == 2
