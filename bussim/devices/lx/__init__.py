"""A PLC as Modbus slave of which nothing else is simulated."""
