"""Search methods, objectives, stopping rules, and the decisions of a campaign; no MPI, no files."""
