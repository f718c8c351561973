"""The campaign file in HDF5: its tables, written, read and verified."""
