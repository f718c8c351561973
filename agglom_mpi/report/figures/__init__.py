"""The figures of a campaign; one idea a module, each drawn from plain arrays."""
