"""What one value cannot tell: whether the parts of a scenario fit each other."""
