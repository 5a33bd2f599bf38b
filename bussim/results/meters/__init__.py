"""What a run's records are counted into while it goes on: histograms, gaps, latencies, ports."""
