"""A half-duplex line with its nodes, for any protocol."""
