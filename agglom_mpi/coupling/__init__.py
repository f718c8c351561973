"""A box of grains inside a macroscopic model, stepped from outside  [B 9]."""
