"""The N:N link's engines: codec, master, slave."""
