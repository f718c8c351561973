"""A run on one or many ranks: messages, simulation threads, recording."""
