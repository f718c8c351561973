"""Objectives: what a search minimises, one class each."""
