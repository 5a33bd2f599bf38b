"""The serial ports of a PLC beside its N:N link: CPAVL's parameters, RS2, and what drives it."""
