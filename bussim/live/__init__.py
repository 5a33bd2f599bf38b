"""The same engines on serial ports, in real time, and what is read off a real wire."""
