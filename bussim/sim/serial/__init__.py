"""Buses beside the link: PLC ports and devices that speak Modbus or a protocol of their own."""
