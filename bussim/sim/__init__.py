"""Layer 5: the SimPy simulation of a scenario."""
