"""The serial line: characters and their timing, levels, noise, and the checks that frames carry."""
