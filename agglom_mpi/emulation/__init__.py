"""Gaussian processes: the mean of noisy samples as a function of the point, and its uncertainty."""
