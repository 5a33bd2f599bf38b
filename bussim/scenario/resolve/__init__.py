"""What entries of a draft mean: the bus, profile, port and program of each."""
