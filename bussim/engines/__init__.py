"""Layer 2: sans-IO protocol engines: no clock, no random numbers, no port, no simulation."""
