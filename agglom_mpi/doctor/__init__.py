"""Checks of the machine that is to run campaigns: `agglom doctor`."""
