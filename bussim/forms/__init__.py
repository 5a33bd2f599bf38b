"""Forms of a scenario file: kinds of values, mappings, and where their mistakes are reported."""
