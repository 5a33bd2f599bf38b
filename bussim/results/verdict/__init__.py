"""The verdict of a run: what stations and buses showed, as sentences that are keys with values."""
