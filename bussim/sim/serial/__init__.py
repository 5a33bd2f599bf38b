"""Serial buses: PLC ports and devices with Modbus or the free protocol."""
