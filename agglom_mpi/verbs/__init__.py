"""What a campaign is asked from Python: samples, estimates, and a search in one's own loop."""
