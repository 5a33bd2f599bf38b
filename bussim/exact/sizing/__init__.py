"""Which D8179 and D8180 a link should have: a grid of settings against goals."""
