"""Devices on a bus: Modbus register maps with the behaviour behind them."""
