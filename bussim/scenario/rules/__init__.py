"""Checks across values: whether the parts of a scenario fit each other."""
