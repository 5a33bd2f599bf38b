"""A Modbus slave whose register map the scenario defines."""
