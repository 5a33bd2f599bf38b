"""What a run tells: records, their lines in ``trace.jsonl``, and the file."""
