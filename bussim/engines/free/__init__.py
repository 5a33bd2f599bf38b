"""The free protocol of a PLC's port (RS, RS2): bytes in and out, framed as CPAVL says."""
