"""A small Modbus client, as people write them: the subject of the example test."""

from __future__ import annotations

import serial

from bussim.line.checksums import crc16, crc16_bytes


class NoResponseError(Exception):
    """Every attempt failed."""


class SmallClient:
    """Reads holding registers by RTU, with retries."""

    def __init__(self, device: str, station: int = 1, *, timeout: float = 1.0, retries: int = 2) -> None:
        self._port = serial.Serial(device, 115200, timeout=timeout)
        self._station, self._retries = station, retries
        self.failures: list[str] = []

    def close(self) -> None:
        self._port.close()

    def read(self, address: int, count: int = 1) -> list[int]:
        body = bytes((self._station, 3)) + address.to_bytes(2, "big") + count.to_bytes(2, "big")
        for _ in range(self._retries + 1):
            self._port.reset_input_buffer()
            self._port.write(body + crc16_bytes(body))
            response = self._port.read(5 + 2 * count)
            why = self._why_not(response, count)
            if why is None:
                return [int.from_bytes(response[at : at + 2], "big") for at in range(3, 3 + 2 * count, 2)]
            self.failures.append(why)
        raise NoResponseError(self.failures[-1])

    def _why_not(self, response: bytes, count: int) -> str | None:
        if not response:
            return "silence"
        if len(response) >= 5 and not crc16(response[:5]) and response[1] & 0x80:
            return f"exception {response[2]}"
        if len(response) < 5 + 2 * count:
            return "short"
        if crc16(response):
            return "crc"
        return None if response[0] == self._station else "station"
