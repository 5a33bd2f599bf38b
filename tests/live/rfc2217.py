"""A remote serial port by RFC 2217, whose server is of another project."""

from __future__ import annotations

import socket
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import serial.rfc2217

from tests.live.peers import PATIENCE


class FakePort:
    """A serial port that notes what it is asked for."""

    def __init__(self) -> None:
        self.asked: dict[str, Any] = {}
        self.written = bytearray()
        self.rts = self.dtr = True
        self.cts = self.dsr = self.ri = self.cd = False
        self.break_condition = False
        self.in_waiting = 0

    def __setattr__(self, name: str, value: Any) -> None:
        object.__setattr__(self, name, value)
        if name in ("baudrate", "bytesize", "parity", "stopbits"):
            self.asked[name] = value

    baudrate, bytesize, parity, stopbits = 300, 8, "N", 1
    rtscts = dsrdtr = xonxoff = False

    def reset_input_buffer(self) -> None:
        """Nothing waits."""

    def reset_output_buffer(self) -> None:
        """Nothing waits."""

    def write(self, data: bytes) -> int:
        self.written += data
        return len(data)


class WithoutControl(serial.rfc2217.PortManager):  # type: ignore[misc]
    """A server that knows no control lines: it does not respond to SET-CONTROL."""

    def _telnet_process_subnegotiation(self, suboption: bytes) -> None:
        if suboption[1:2] != serial.rfc2217.SET_CONTROL:
            super()._telnet_process_subnegotiation(suboption)


@contextmanager
def remote(
    manager_of: type[serial.rfc2217.PortManager] = serial.rfc2217.PortManager,
) -> Iterator[tuple[str, FakePort]]:
    """pyserial's PortManager over a port that notes its settings."""
    fake = FakePort()
    server = socket.create_server(("127.0.0.1", 0))
    server.settimeout(PATIENCE)
    done = threading.Event()

    def serve() -> None:
        connection, _ = server.accept()
        connection.settimeout(0.05)

        class Network:
            def write(self, data: bytes) -> None:
                connection.sendall(data)

        manager = manager_of(fake, Network())
        while not done.is_set():
            try:
                data = connection.recv(1024)
            except TimeoutError:
                continue
            except OSError:
                break
            if not data:
                break
            fake.write(b"".join(manager.filter(data)))
        connection.close()

    thread = threading.Thread(target=serve)
    thread.start()
    try:
        yield f"rfc2217://127.0.0.1:{server.getsockname()[1]}", fake
    finally:
        done.set()
        thread.join()
        server.close()
