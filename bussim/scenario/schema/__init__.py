"""The form of a scenario file: keys, values, their ranges and messages."""
