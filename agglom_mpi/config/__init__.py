"""The campaign file in YAML: typed, with units, every error with file, line and field."""
