"""Layer 4: scenario files: their values, schema, loader and the built-in ones."""
