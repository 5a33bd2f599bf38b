"""One link scan without memory from scan to scan: its distribution, and what outages do to it."""
