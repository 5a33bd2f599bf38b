"""Traces of a run: records, their lines in ``trace.jsonl``, and the file."""
