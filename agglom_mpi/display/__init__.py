"""Progress of a run on the terminal or as log lines."""
