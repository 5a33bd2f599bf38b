"""A PLC: devices, profiles, scan cycle, link registers, programs and serial ports."""
