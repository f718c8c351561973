"""Forecasts of the run time of a campaign: `agglom plan`."""
