"""Layer 3: the PLC around the link: devices, profiles, scan cycle, noise and faults."""
