"""Recordings of lines that others made: pcapng, sigrok, raw bytes with timestamps."""
