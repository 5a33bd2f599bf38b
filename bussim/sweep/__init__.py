"""Grids of simulations: what to vary, running it on many processes, tables and pictures."""
