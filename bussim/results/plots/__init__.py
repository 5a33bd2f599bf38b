"""Pictures of runs, of exact distributions and of sizings."""
