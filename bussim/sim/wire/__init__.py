"""A half-duplex line and what sits on it, whatever protocol is spoken."""
