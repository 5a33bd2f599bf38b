"""What the instructions do."""
