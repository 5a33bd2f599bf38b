"""From text to data with marks: YAML, the files that it names, overrides, and back to text."""
