"""A run's results in words and small tables, and their entries in ``summary.json``."""
