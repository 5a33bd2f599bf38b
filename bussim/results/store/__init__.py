"""The folder of a run: tables, traces and summaries, written and read back."""
