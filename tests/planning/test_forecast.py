import io
import json
import math

import pytest
from examples import examples
from hypothesis import strategies as st
from rich.console import Console

from agglom_mpi.config.campaign import Campaign
from agglom_mpi.config.loading import load_campaign
from agglom_mpi.planning.forecast import (
    SATURATED,
    WELL_USED,
    Forecast,
    ForecastReport,
    MessageCosts,
    PilotSummary,
    forecast_table,
    to_json,
)

COSTS = MessageCosts(2e-3, 30e-6, 1e-6, 5e-6)


def planned(*forecasts):
    return ForecastReport(None, "a.yaml", None, COSTS, list(forecasts), [])


def forecast(ranks, seconds, work=100.0, again=0.0):
    return Forecast(ranks, seconds, 1.0, 10, 10, work, 1.0, 0.0, again)


def test_the_most_ranks_that_are_well_used_are_advised():
    plan = planned(forecast(1, 100.0), forecast(4, 30.0), forecast(8, 25.0), forecast(16, 15.0))
    assert [f.needed for f in plan.forecasts] == pytest.approx([1.0, 0.83, 0.5, 0.42], abs=0.004)
    assert plan.advice.ranks == 8
    backwards = planned(*plan.forecasts[::-1])
    assert backwards.advice == plan.advice


def test_no_number_of_ranks_is_advised_that_its_row_does_not_bear_out():
    assert planned(forecast(64, 20.0), forecast(16, 19.0)).advice is None


ROWS = st.tuples(st.integers(1, 10_000), st.floats(1e-3, 1e6), st.floats(0.0, 1.0))


@examples(200, st.lists(ROWS, max_size=6))
def test_the_advice_agrees_with_the_table(rows):
    """A row of (ranks, time, share of the ranks' time that is needed)."""
    forecasts = [
        forecast(ranks, seconds, work=share * seconds * ranks) for ranks, seconds, share in rows
    ]
    advice = planned(*forecasts).advice
    well_used = {f.ranks for f in forecasts if f.needed >= WELL_USED}
    if advice is None:
        assert not well_used
    else:
        assert advice.ranks == max(well_used)
        assert advice.needed >= WELL_USED
        assert (advice.ranks, advice.needed) in {(f.ranks, f.needed) for f in forecasts}


def test_rank_0_is_saturated_from_the_first_row_on_that_shows_it():
    rows = [
        forecast(ranks, 20.0)._replace(master=master, simulated=50)
        for ranks, master in ((100, 1.0), (1, 0.1), (10, SATURATED))
    ]
    full = planned(*rows).saturation
    assert (full.ranks, full.samples_per_second) == (10, 2.5)
    assert planned(rows[1]).saturation is None


def test_the_walltime_is_twice_the_forecast_and_a_start_in_whole_five_minutes():
    assert planned(forecast(1, 100.0)).advice.walltime == 600.0
    assert planned(forecast(1, 140.0, 140.0, again=20.0)).advice.walltime == 900.0
    assert planned(forecast(1, 36_000.0, 36_000.0)).advice.walltime == 72_300.0


def test_nothing_is_advised_without_a_forecast():
    assert planned().advice is None


def heading(wall_over_cpu):
    summary = PilotSummary(None, 60, 10, 0, 2e-3, 5e-3, wall_over_cpu, ())
    campaign = load_campaign("jobs/quickstart.yaml")
    report = ForecastReport(campaign, "a.yaml", summary, COSTS, [forecast(1, 100.0)], [])
    console = Console(width=200, file=io.StringIO())
    console.print(forecast_table(report))
    lines = console.file.getvalue().splitlines()
    return [line.strip() for line in lines[1 : [line[:6].strip() for line in lines].index("ranks")]]


def test_a_forecast_names_its_clock_and_a_busy_machine():
    samples, *_ = heading(1.0)
    assert samples.endswith("mean 2 ms, longest 5 ms of processor time")
    samples, busy, *_ = heading(2.5)
    assert samples.endswith("of processor time")
    assert "samples took 2.5 times their processor time" in busy
    assert len(busy) < 80
    samples, *_ = heading(math.nan)
    assert samples.endswith("of wall-clock time")


def test_the_ratio_of_the_clocks_is_in_the_json_where_it_is_known():
    def ratio(value):
        summary = PilotSummary(None, 60, 10, 0, 2e-3, 5e-3, value, ())
        campaign = load_campaign("jobs/quickstart.yaml")
        report = ForecastReport(campaign, "a.yaml", summary, COSTS, [], [])
        return json.loads(to_json(report))["samples"]["wall_over_cpu"]

    assert ratio(2.5) == 2.5
    assert ratio(math.nan) is None


def test_what_a_certificate_takes_at_most_is_named():
    text = (
        load_campaign("jobs/polymer_dust.yaml").text + "certify: {strings: 50, max_samples: 100}\n"
    )
    summary = PilotSummary(None, 60, 10, 0, 0.72, 5.0, 1.0, ())
    report = ForecastReport(Campaign.from_text(text), "a.yaml", summary, COSTS, [], [])
    console = Console(width=200, file=io.StringIO())
    console.print(forecast_table(report))
    assert "at most 5,000 samples more, 1 core-hours" in console.file.getvalue()
