"""An exported emulator answers as the campaign's own does, and refuses what it does not know."""

import os
import subprocess
import sys

import numpy as np
import pytest
from campaign_runs import finish
from click.testing import CliRunner
from set_runs import three_variable_file, three_variable_text

import agglom_mpi
from agglom_mpi import load_emulator
from agglom_mpi.inference import portable_emulator
from agglom_mpi.inference.data_emulator import EmulatedData
from agglom_mpi.inference.emulator_file import NoEmulatorError, emulator_arrays
from agglom_mpi.inference.portable_emulator import GROWTH, PortableEmulator
from agglom_mpi.inference.searched_box import SearchedBox
from agglom_mpi.inference.stored_samples import stored_samples, string_values
from agglom_mpi.storage.reader import read_campaign
from agglom_mpi.storage.recorded_campaign import recorded_campaign

POINTS = 2500
"""Number of strings that are asked for; more than are evaluated together."""
AGREEMENT = 1e-12
"""Of means, relative; of deviations relative to those without data, as they are differences."""
MEMBER = {"relative_speed": 4.3, "hardness": 67e6, "friction": 0.3}


def export(path, *words):
    from agglom_mpi.cli import main

    return CliRunner().invoke(main, ["export", str(path), *map(str, words)])


@pytest.fixture(scope="module")
def exported(three, tmp_path_factory):
    """Return the path of the exported emulator of the campaign of three variables."""
    path = tmp_path_factory.mktemp("exported") / "three.npz"
    done = export(three.path, "--emulator", path, "--tolerance", "5%")
    assert done.exit_code == 0, done.output
    return path


def inside(emulator, count=POINTS):
    """Return strings that fill the box of an emulator, by name."""
    random = np.random.default_rng(5)
    return {name: random.uniform(*ends[:2], count) for name, ends in emulator.box.items()}


def test_it_answers_as_the_set_of_the_campaign_does(exported, doubling):
    emulator = PortableEmulator(exported)
    strings = inside(emulator)
    process = doubling.emulated.emulator.processes[0].process.arrays()
    prior = process["scale"] * np.sqrt(process["variance"])
    assert emulator.mean(strings) == pytest.approx(doubling.mean(strings), rel=AGREEMENT)
    expected = doubling.deviation(strings)
    assert emulator.deviation(strings) == pytest.approx(expected, rel=0, abs=AGREEMENT * prior)
    expected = doubling.probability(strings)
    assert emulator.probability(strings) == pytest.approx(expected, rel=0, abs=1e-9)
    assert expected.max() > 0.5


def test_a_file_is_loaded_as_its_campaign_is(exported, three):
    written, made = load_emulator(exported), load_emulator(three.path)
    strings = inside(written, 20)
    for name in ("mean", "deviation", "probability"):
        assert np.array_equal(getattr(written, name)(strings), getattr(made, name)(strings))
    assert written.about == made.about
    assert written.about["title"] == three.title
    assert written.about["version"] == agglom_mpi.__version__
    assert written.box == made.box
    assert written.box["relative_speed"] == (0.1, 30.0, "m/s", "linear")
    assert written.quantities == {GROWTH: "1"}


def test_values_may_be_texts_with_units_and_of_any_shape(exported):
    emulator = load_emulator(exported)
    plain = emulator.mean(MEMBER)
    assert plain.shape == ()
    assert emulator.mean(MEMBER | {"hardness": "67 MPa"}) == plain
    many = emulator.mean(MEMBER | {"hardness": ["67 MPa", "80 MPa"], "friction": [[0.3], [0.2]]})
    assert many.shape == (2, 2)
    assert many[0, 0] == pytest.approx(plain, rel=AGREEMENT)
    assert emulator.mean(MEMBER | {"hardness": []}).shape == (0,)
    with pytest.raises(ValueError, match="hardness: "):
        emulator.mean(MEMBER | {"hardness": "67 m"})


@pytest.mark.parametrize(
    ("changed", "words"),
    [
        ({"hardness": [67e6, 3e9]}, ("hardness: value 3e+09", "1e+07 to 2e+08 Pa")),
        ({"friction": np.nan}, ("friction: value nan", "0.01 to 0.5")),
        ({"density": 2000.0}, ("density: unknown",)),
        ({"friction": None}, ("friction:", "missing")),
    ],
)
def test_what_is_outside_of_the_box_is_refused(exported, changed, words):
    given = {name: x for name, x in (MEMBER | changed).items() if x is not None}
    for emulator in (PortableEmulator(exported), load_emulator(exported)):
        for ask in (emulator.mean, emulator.deviation, emulator.probability):
            with pytest.raises(ValueError) as refused:  # noqa: PT011
                ask(given)
            assert all(word in str(refused.value) for word in words)
    with pytest.raises(ValueError, match=f"quantity: value d50; must be {GROWTH}"):
        PortableEmulator(exported).mean(MEMBER, "d50")


def test_the_module_beside_it_needs_numpy_alone(exported):
    module = exported.with_suffix(".py")
    lines = module.read_text().splitlines()
    assert len(lines) <= 80
    code = (
        "import sys; sys.modules |= dict.fromkeys(['scipy', 'agglom_mpi', 'h5py', 'numba']); "
        "import three; print(repr(float(three.PortableEmulator().mean("
        "{'relative_speed': 4.3, 'hardness': 67e6, 'friction': 0.3}))))"
    )
    done = subprocess.run(
        [sys.executable, "-c", code],
        cwd=exported.parent,
        capture_output=True,
        text=True,
        check=True,
    )
    assert float(done.stdout) == pytest.approx(float(load_emulator(exported).mean(MEMBER)))


def test_the_file_has_no_pickles(exported):
    with np.load(exported, allow_pickle=False) as found:
        assert all(found[name].dtype.kind in "fiubU" for name in found.files)


def test_measured_data_are_those_of_the_posterior(measured_file, monkeypatch):
    monkeypatch.setattr("agglom_mpi.inference.stored_samples.MIN_STRINGS", 5)
    emulator = load_emulator(measured_file)
    file = read_campaign(measured_file)
    campaign, stored = recorded_campaign(file), stored_samples(file)
    values = string_values(file, campaign.data, stored)
    of = EmulatedData(SearchedBox(campaign), campaign.data, values, stored)
    strings = inside(emulator, 40)
    own = of.box.strings(strings)
    residuals, covariances = of.framed_residuals(own)
    back, basis = np.linalg.pinv(of.frame.basis), of.frame.basis
    rest = np.concatenate([datum.values for datum in of.data])
    rest = rest - rest @ basis @ back
    errors = covariances - np.eye(covariances.shape[1])
    assert list(emulator.quantities) == [GROWTH, *(datum.name for datum in of.data)]
    assert emulator.box["relative_speed"] == (0.01, 0.3, "m/s", "log")
    for datum, rows in zip(of.data, of.frame.rows, strict=True):
        mean, deviation = (f(strings, datum.name) for f in (emulator.mean, emulator.deviation))
        assert emulator.quantities[datum.name] == datum.kind.unit
        shape = (40, len(datum.values)) if len(datum.values) > 1 else (40,)
        assert mean.shape == deviation.shape == shape
        predicted = (of.frame.measured @ basis - residuals) @ back[:, rows]
        typical = (of._typical - of._typical @ basis @ back)[rows]
        scale = np.abs(mean).max()
        assert mean.reshape(40, -1) == pytest.approx(predicted + typical, abs=1e-11 * scale)
        variances = np.einsum("pq,npr,rq->nq", back[:, rows], errors, back[:, rows])
        assert deviation.reshape(40, -1) ** 2 == pytest.approx(variances, rel=1e-6)
        assert (datum.name in emulator.edges) == (len(shape) == 2)
        assert datum.edges is None or np.array_equal(emulator.edges[datum.name], datum.edges)
    with pytest.raises(ValueError, match="no target"):
        emulator.probability(strings)


def test_a_volume_fraction_is_given_as_such(filled, half):
    arrays = emulator_arrays(filled, "25%")
    path = filled.path.with_name("filled.npz")
    np.savez(path, **arrays)
    emulator = PortableEmulator(path)
    strings = inside(emulator, 200)
    assert emulator.box["volume_fraction"][:2] == pytest.approx((0.1, 0.3))
    assert emulator.mean(strings) == pytest.approx(half.mean(strings), rel=1e-11)
    assert emulator.probability(strings) == pytest.approx(half.probability(strings), abs=1e-9)


@pytest.mark.slow
def test_strings_that_fail_are_less_likely(three, exported, monkeypatch):
    """A fifth of the strings, those of the largest speed, are made to fail."""
    from agglom_mpi.inference import emulator_file, feasible_set
    from agglom_mpi.inference import stored_samples as module

    def with_failures(data):
        stored = module.stored_samples(data)
        speed = stored.tried[:, 0]
        failed = speed > np.quantile(speed, 0.8)
        good = ~np.isin(stored.strings[:, 0], speed[failed])
        return module.StoredSamples(stored.strings[good], stored.rows[good], stored.tried, failed)

    for each in (emulator_file, feasible_set):
        monkeypatch.setattr(each, "stored_samples", with_failures)
    emulator = load_emulator(three.path)
    found = three.feasible_set("5%")
    strings = inside(emulator, 200)
    assert found.failing > 0
    assert emulator.probability(strings) == pytest.approx(found.probability(strings), abs=1e-9)


def test_nothing_is_overwritten_or_half_written(exported, three, tmp_path):
    def said(*words):
        done = export(three.path, *words)
        assert done.exit_code == 2
        return done.stderr

    assert "exists already" in said("--emulator", exported)
    (tmp_path / "x.py").write_text("precious")
    assert "x.py: exists already" in said("--emulator", tmp_path / "x.npz")
    assert "must end with .npz" in said("--emulator", tmp_path / "x.dat")
    assert "nowhere: No such file" in said("--emulator", tmp_path / "nowhere" / "x.npz")
    assert "tolerance" in said("--emulator", tmp_path / "y.npz", "--tolerance", "5")
    assert "same file" in said("--emulator", tmp_path / "y.npz", "--compact", tmp_path / "y.py")
    assert "--tolerance is for" in said("--csv", tmp_path / "t", "--tolerance", "5%")
    assert os.listdir(tmp_path) == ["x.py"]


def test_a_campaign_without_an_emulator_says_why(finished, measured_file, tmp_path):
    done = export(finished, "--emulator", tmp_path / "x.npz")
    assert (done.exit_code, done.stderr.count("\n")) == (2, 1)
    assert "strings; at least 50 are needed" in done.stderr
    words = "--emulator", tmp_path / "x.npz", "--tolerance", "5%"
    assert "measured.h5: tolerance" in export(measured_file, *words).stderr
    assert os.listdir(tmp_path) == []


def test_common_configurations_have_no_emulator(tmp_path, monkeypatch):
    path = three_variable_file(tmp_path, generations=1)
    monkeypatch.setattr("agglom_mpi.config.campaign.Campaign.common_configurations", True)
    with pytest.raises(NoEmulatorError, match=r"three\.h5: ensemble\.common_configurations"):
        load_emulator(path)


@pytest.mark.parametrize("content", [b"", b"text", b"PK\x03\x04 no archive"])
def test_what_is_no_emulator_is_one_message(tmp_path, content):
    path = tmp_path / "x.npz"
    path.write_bytes(content)
    with pytest.raises(NoEmulatorError, match=r"x\.npz: no emulator"):
        load_emulator(path)
    np.savez(path, format=np.array(portable_emulator.FORMAT + 1))
    with pytest.raises(NoEmulatorError, match="format: value 2; must be 1"):
        load_emulator(path)
    with pytest.raises(ValueError, match="format: value 2; must be 1"):
        PortableEmulator(path)
    with pytest.raises(NoEmulatorError, match="tolerance"):
        load_emulator(path, "5%")
    with pytest.raises(FileNotFoundError):
        load_emulator(tmp_path / "absent.npz")


@pytest.mark.slow
def test_maximum_growth_has_no_band_and_constraints_are_named(tmp_path):
    allowed = "density * relative_speed**2 < 10 * hardness"
    options = {"objective": "{law: maximum_growth}", "constraints": f'["{allowed}"]'}
    path = three_variable_file(tmp_path, **options)
    emulator, found = load_emulator(path), agglom_mpi.open_campaign(path).feasible_set()
    strings = inside(emulator, 50)
    assert emulator.quantities == {GROWTH: "1"}
    assert allowed in emulator.about["constraints"]
    assert emulator.mean(strings) == pytest.approx(found.mean(strings), rel=1e-11)
    with pytest.raises(ValueError, match="no target"):
        emulator.probability(strings)
    with pytest.raises(ValueError, match="tolerance"):
        load_emulator(path, "5%")


@pytest.mark.slow
def test_the_value_of_ones_own_function_stands_beside_growth(tmp_path):
    (tmp_path / "shape.py").write_text("def worth(sample):\n    return sample.mean_radius_ratio\n")
    text = three_variable_text(objective="{law: function, call: 'shape:worth'}", final="none")
    (tmp_path / "own.yaml").write_text(text)
    finish(tmp_path, "own.yaml", "--allow-code")
    path = tmp_path / "own.h5"
    emulator = load_emulator(path, 2.0, allow_code=True)
    found = agglom_mpi.open_campaign(path, allow_code=True).feasible_set(2.0)
    strings = inside(emulator, 50)
    assert list(emulator.quantities) == [GROWTH, "objective"]
    assert emulator.mean(strings, "objective") == pytest.approx(found.mean(strings), rel=1e-11)
    assert emulator.probability(strings) == pytest.approx(found.probability(strings), abs=1e-9)
    difference = emulator.mean(strings) - emulator.mean(strings, "objective")
    # Of the same numbers, in other coordinates.
    unsure = np.hypot(emulator.deviation(strings), emulator.deviation(strings, "objective"))
    assert np.median(np.abs(difference) / unsure) < 3.0
