"""The event-driven engine: exact times of collisions, predicted for one particle at a time."""
