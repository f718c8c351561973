"""The campaign file: schema, writer and reader."""
