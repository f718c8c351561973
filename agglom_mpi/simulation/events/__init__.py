"""The event-driven engine: exact times, and work only for who is touched."""
