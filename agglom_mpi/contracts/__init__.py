"""Properties that components promise, tested on random numbers before anything runs."""
