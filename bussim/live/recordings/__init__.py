"""Recordings of lines by other programs: pcapng, sigrok, raw bytes with timestamps."""
