"""Estimates, from what a listener heard, of what the model needs."""
