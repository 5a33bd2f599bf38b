"""Layer 6: what a run leaves behind: statistics, summary, files and plots.

Reads the records of :mod:`bussim.trace.records` and nothing of who made them.
"""
