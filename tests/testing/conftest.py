from __future__ import annotations

# The plugin's fixtures, whether or not this bussim is installed with its entry point.
from bussim.testing.plugin import modbus_serve, modbus_slave

__all__ = ["modbus_serve", "modbus_slave"]
