"""A program's rungs as closures that are bound to a machine."""
