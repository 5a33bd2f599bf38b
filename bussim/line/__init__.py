"""Layer 1: characters, their timing, and the checks that frames carry."""
