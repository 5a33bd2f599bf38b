"""The N:N link on its line: master and slaves, and the short ways for what nearly always happens."""
