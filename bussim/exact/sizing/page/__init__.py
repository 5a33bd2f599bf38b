"""The figures of a sizing page, as plain data."""
