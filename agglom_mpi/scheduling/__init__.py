"""Which rank simulates which samples: pure state machines, without MPI, files or a clock."""
