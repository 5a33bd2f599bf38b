"""Sans-IO protocol engines: no clock, no random numbers, no port, no simulation."""
