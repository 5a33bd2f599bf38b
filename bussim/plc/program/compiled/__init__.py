"""A program's blocks as Python functions that are bound to a machine."""
