"""The Modbus serial-line engines: codec, RTU and ASCII framing, master, polls, slave."""
