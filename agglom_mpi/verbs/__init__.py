"""Verbs of a campaign in Python: samples, estimates, and a search in one's own loop."""
