"""Which rank simulates which samples; no MPI, no files, no clock."""
