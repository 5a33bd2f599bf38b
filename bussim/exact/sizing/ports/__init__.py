"""Timeout, retries and interval of a Modbus master's port."""
