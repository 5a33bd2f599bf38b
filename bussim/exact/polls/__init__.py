"""Modbus poll lists without simulating: cycle times, worst cases, ages of data."""
