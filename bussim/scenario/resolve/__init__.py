"""What entries of a draft mean: who sits where, with which profile, port and program."""
