"""The SimPy simulation of a scenario."""
