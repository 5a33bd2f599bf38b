"""The N:N link on its line: master and slaves, and the fast path for what nearly always happens."""
