"""The N:N link on its line: master and slaves, and whole link scans at once where nothing comes between."""
