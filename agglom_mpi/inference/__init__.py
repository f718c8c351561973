"""Which strings are compatible with a campaign's question, by all of its samples."""
