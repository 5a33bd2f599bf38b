"""Parts of a scenario on real ports, while the rest of it is simulated in real time."""
