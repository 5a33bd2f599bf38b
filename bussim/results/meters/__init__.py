"""Counters of a run's records while it goes on: link scans, refresh gaps, ports, latencies, devices."""
