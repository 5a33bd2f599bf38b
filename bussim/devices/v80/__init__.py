"""The V80 or PPC controller as Modbus slave."""
