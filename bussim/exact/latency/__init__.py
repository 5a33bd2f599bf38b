"""Bounds of latencies, in closed form."""
