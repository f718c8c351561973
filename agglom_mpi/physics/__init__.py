"""Formulas of one pair or one grain: one file per physical question, no loops over particles."""
