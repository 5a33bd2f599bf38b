"""Scenario files: their values, schema, loader and the built-in ones."""
