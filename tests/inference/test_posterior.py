import numpy as np
import pytest

from agglom_mpi.config.yaml_source import CampaignError
from agglom_mpi.inference.data_posterior import measurement_of
from agglom_mpi.inference.posterior import PosteriorError
from agglom_mpi.inference.posterior_sampling import effective_size


@pytest.fixture(scope="module")
def posterior(doubling):
    return doubling.posterior(2.0, 0.05)


def test_weighted_strings_give_the_measured_mean_back(doubling, posterior):
    draws = posterior.draws
    assert draws["weight"].sum() == pytest.approx(1.0)
    mean = doubling.mean(draws.drop(columns="weight"))
    spread = np.sqrt(draws["weight"] @ (mean - 2.0) ** 2)
    assert abs(draws["weight"] @ mean - 2.0) < 0.05
    assert 0.02 < spread < 0.15


def test_quantiles_are_in_order_and_inside_the_box(posterior):
    found = posterior.quantiles("relative_speed")
    assert list(found) == sorted(found)
    assert 1.0 < found[0] < found[-1] < 12.0


def test_what_pairs_hide_partial_correlations_show(posterior):
    """Speed and hardness rise together.

    A hundredth of the weight in a corner without any sample lowers a correlation of 0.98 to 0.7.
    """
    names = list(posterior.of.box.names)
    speed, hardness = names.index("relative_speed"), names.index("hardness")
    assert posterior.correlations[speed, hardness] > 0.5
    assert posterior.partial_correlations[speed, hardness] > 0.5
    assert np.diag(posterior.partial_correlations) == pytest.approx(1.0)


def test_the_effective_size_of_equal_weights_is_their_number():
    assert effective_size(np.full(40, 0.3)) == pytest.approx(40.0)
    assert effective_size(np.array([1.0, 0.0, 0.0])) == pytest.approx(1.0)
    assert effective_size(np.zeros(3)) == 0.0


def test_drawn_strings_follow_the_weights(posterior):
    """The median of 2000 draws is within 4 standard errors in rank of the weighted one."""
    drawn = posterior.sample(2000, seed=3)["hardness"].to_numpy()
    below = np.mean(drawn < posterior.quantiles("hardness")[2])
    assert abs(below - 0.5) < 4.0 * 0.5 / np.sqrt(2000) + 0.01


@pytest.mark.parametrize(
    ("measured", "error", "said"),
    [
        (2.0, 0.0, "error: .*0"),
        (float("nan"), 0.1, "measured: .*nan"),
        (2.0, 5, "error: .*5.*2, .*'5%'"),
        (2.0, "wide", "error: .*'wide'"),
        (2.0, True, "error: .*True"),
        (2.0, "100%", "error: .*100%.*2"),
        (9.0, 0.01, "measured: .*9.0.*100 .*4.642"),
        (-2.0, 0.01, "measured: .*-2.0"),
        (0.0, 0.01, "measured: .*0.0"),
        (2.0, 1e300, "error: .*1e.?300"),
        (1e300, 1e299, "measured: .*1e.?300"),
        (2.0, 1e-300, "error: .*1e-300"),
    ],
)
def test_impossible_measurements_are_refused(doubling, measured, error, said):
    with pytest.raises(ValueError, match=said):
        doubling.posterior(measured, error)


def test_a_measured_mean_that_no_string_comes_near_is_refused(half):
    with pytest.raises(PosteriorError, match=r"4\.6 ± 0\.01"):
        half.posterior(4.6, 0.01)


def test_a_measurement_of_several_numbers_is_refused_without_an_emulator(doubling):
    with pytest.raises(PosteriorError, match="mean, standard_deviation"):
        measurement_of(doubling.emulated.box.campaign, ("mean", "standard_deviation"), 2.0, 0.1)


def test_an_error_in_percent_is_relative_to_what_was_measured(doubling):
    assert doubling.posterior("2", "2%").of.error == pytest.approx(0.04)


def test_quantiles_are_of_searched_variables(doubling):
    with pytest.raises(CampaignError, match=r"speed: .*'relative_speed'"):
        doubling.posterior(2.0, 0.1).quantiles("speed")


def test_a_chain_takes_over_where_weights_are_too_few(doubling, posterior, monkeypatch):
    pytest.importorskip("emcee")
    monkeypatch.setattr("agglom_mpi.inference.posterior_sampling.MIN_SIZE", 1e9)
    chain = doubling.posterior(2.0, 0.05)
    assert chain.method == "chain"
    for name in doubling.emulated.box.names:
        share = np.mean(chain.draws[name] < posterior.quantiles(name)[2])
        # Half of the chain is below the median, by as many independent strings as both are worth.
        sizes = np.array([min(chain.effective_size, 1000), posterior.effective_size])
        assert abs(share - 0.5) < 4.0 * 0.5 * np.sqrt(np.sum(1.0 / sizes))


def test_a_measured_mean_has_no_predictions_for_data(posterior):
    with pytest.raises(PosteriorError, match="three"):
        _ = posterior.predictions
    assert posterior.calibration is None
    assert (posterior.as_dict()["measured"], posterior.as_dict()["error"]) == (2.0, 0.05)
