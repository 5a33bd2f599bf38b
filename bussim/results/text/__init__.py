"""A run's results as text and small tables for a terminal, from ``summary.json``."""
