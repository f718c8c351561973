"""Measured data against simulated samples: predictions, their errors, and the misfit."""
