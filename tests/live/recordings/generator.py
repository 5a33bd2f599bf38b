"""Lines of known truth, written as recordings of every kind. Nothing here is shared with the readers.

Checks are computed bit by bit, waveforms are drawn sample by sample, and files are put together from the
descriptions of their formats.
"""

from __future__ import annotations

import random
import struct
import zipfile
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from tests.checksums import crc_by_definition


class Sent(NamedTuple):
    """Characters that were sent: seconds, who (0: the master), and which bits of them are wrong.

    ``flips`` are numbers of bits, counted from the first start bit.
    """

    at: float
    chars: bytes
    wire: int = 0
    flips: tuple[int, ...] = ()


class Serial(NamedTuple):
    """Rate and format of a line."""

    baud: int
    data: int = 8
    parity: str = "N"
    stops: int = 1

    @property
    def bits(self) -> int:
        return 1 + self.data + (self.parity != "N") + self.stops

    @property
    def name(self) -> str:
        return f"{self.data}{self.parity}{self.stops}"

    def lasts(self, chars: int) -> float:
        return chars * self.bits / self.baud

    def levels(self, value: int) -> list[int]:
        data = [value >> bit & 1 for bit in range(self.data)]
        parity = {"N": [], "E": [sum(data) % 2], "O": [1 - sum(data) % 2]}[self.parity]
        return [0, *data, *parity, *[1] * self.stops]


# -- frames ----------------------------------------------------------------------------------------------


def crc(data: bytes) -> bytes:
    return struct.pack("<H", crc_by_definition(data))


def rtu(*parts: int | bytes) -> bytes:
    body = b"".join(part if isinstance(part, bytes) else bytes((part,)) for part in parts)
    return body + crc(body)


def ascii_frame(body: bytes) -> bytes:
    return b":" + (body + bytes((-sum(body) & 0xFF,))).hex().upper().encode() + b"\r\n"


def nn_data(station: int, counter: int, data: bytes) -> bytes:
    body = f"{station:X}{counter:X}{data.hex().upper()}\x03".encode()
    return b"\x02" + body + f"{sum(body) & 0xFF:02X}".encode()


def nn_poll(station: int, counter: int) -> bytes:
    body = f"{station:X}{counter:X}".encode()
    return b"\x05" + body + f"{sum(body) & 0xFF:02X}".encode()


def pair(rng: random.Random) -> tuple[bytes, bytes]:
    """A request and its response, without station and check."""
    kind = rng.randrange(6)
    address = rng.randrange(0x8000)
    if kind == 0:
        count = rng.randint(1, 10)
        return struct.pack(">BHH", 3, address, count), bytes((3, 2 * count)) + rng.randbytes(2 * count)
    if kind == 1:
        count = rng.randint(1, 40)
        size = -(-count // 8)
        return struct.pack(">BHH", 1, address, count), bytes((1, size)) + rng.randbytes(size)
    if kind == 2:
        write = struct.pack(">BHH", 6, address, rng.randrange(0x10000))
        return write, write
    if kind == 3:
        count = rng.randint(1, 5)
        head = struct.pack(">BHH", 16, address, count)
        return head + bytes((2 * count,)) + rng.randbytes(2 * count), head
    if kind == 4:
        mask = struct.pack(">BHHH", 22, address, rng.randrange(0x10000), rng.randrange(0x10000))
        return mask, mask
    count = rng.randint(1, 8)
    head = struct.pack(">BHHHHB", 23, address, count, address, 1, 2) + rng.randbytes(2)
    return head, bytes((23, 2 * count)) + rng.randbytes(2 * count)


def modbus(
    serial: Serial,
    count: int,
    seed: int,
    *,
    frame: Callable[[bytes], bytes] = lambda body: body + crc(body),
    lost: float = 0.0,
    damaged: float = 0.0,
    begin: float = 0.05,
) -> tuple[list[Sent], dict[str, int]]:
    """Exchanges of a master with three slaves, and the number of each outcome.

    The master repeats nothing and polls every 200 characters; a slave responds after five to nine of them.
    """
    rng = random.Random(seed)
    sent: list[Sent] = []
    outcomes = {"ok": 0, "no_answer": 0, "damaged": 0}
    for number in range(count):
        at = begin + serial.lasts(400) * number
        station = bytes((1 + number % 3,))
        request, response = (frame(station + pdu) for pdu in pair(rng))
        sent.append(Sent(at, request))
        if rng.random() < lost and number + 1 < count:
            outcomes["no_answer"] += 1
            continue
        flips: tuple[int, ...] = ()
        if rng.random() < damaged and number + 1 < count:
            # A data bit inside the frame: with a parity bit both verdict and sum are wrong.
            char = rng.randrange(1, len(response) - 1)
            flips = (char * serial.bits + 1 + rng.randrange(serial.data),)
        outcomes["damaged" if flips else "ok"] += 1
        sent.append(
            Sent(at + serial.lasts(len(request)) + serial.lasts(rng.randint(5, 9)), response, 1, flips)
        )
    return sent, outcomes


def nn_link(serial: Serial, scans: int, slaves: int = 2, *, begin: float = 0.05) -> list[Sent]:
    """An N:N link in mode 0 whose stations all reply."""
    rng, now, sent = random.Random(slaves), begin, []
    gap = 0.0004175 * 38400 / serial.baud
    for scan in range(scans):
        for wire, chars in (
            (0, nn_data(0, scan % 16, rng.randbytes(8))),
            *(
                pair_
                for k in range(1, slaves + 1)
                for pair_ in ((0, nn_poll(k, scan % 16)), (1, nn_data(k, scan % 16, rng.randbytes(8))))
            ),
        ):
            sent.append(Sent(now, chars, wire))
            now += serial.lasts(len(chars)) + gap
        now += 10 * gap
    return sent


# -- recordings ------------------------------------------------------------------------------------------


def wave(sent: Iterable[Sent], serial: Serial, rate: int, *, tail: float = 0.05) -> np.ndarray:
    """The level of a line, sample by sample, high when idle."""
    sent = list(sent)
    end = max(each.at + serial.lasts(len(each.chars)) for each in sent) + tail
    level = np.ones(int(end * rate) + 1, dtype=np.uint8)
    for each in sent:
        bits = [bit for value in each.chars for bit in serial.levels(value)]
        for number in each.flips:
            bits[number] ^= 1
        edges = np.rint((each.at + np.arange(len(bits) + 1) / serial.baud) * rate).astype(int)
        level[edges[0] : edges[-1]] = np.repeat(np.array(bits, dtype=np.uint8), np.diff(edges))
    return level


def sigrok(path: Path, rate: int, channels: dict[str, np.ndarray]) -> Path:
    """A session with a bit for each channel; shorter ones stay at their last level."""
    length = max(map(len, channels.values()))
    samples = np.zeros(length, dtype=np.uint8)
    for bit, level in enumerate(channels.values()):
        samples |= np.pad(level, (0, length - len(level)), mode="edge") << bit
    names = "".join(f"probe{number}={name}\n" for number, name in enumerate(channels, 1))
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as file:
        file.writestr("version", "2")
        file.writestr(
            "metadata",
            f"[global]\nsigrok version=0.5.2\n\n[device 1]\ncapturefile=logic-1\n"
            f"total probes={len(channels)}\nsamplerate={rate}\n{names}unitsize=1\n",
        )
        file.writestr("logic-1-1", samples.tobytes())
    return path


def pcap(path: Path, sent: Iterable[Sent], link_type: int, *, order: str = "<", nano: bool = False) -> Path:
    """A classic pcap file, its times since 1970."""
    units = 10**9 if nano else 10**6
    data = struct.pack(order + "IHHiIII", 0xA1B23C4D if nano else 0xA1B2C3D4, 2, 4, 0, 0, 65535, link_type)
    for each in sent:
        seconds, part = divmod(round((1_767_600_000 + each.at) * units), units)
        chars = (bytes(12) if link_type == 250 else b"") + each.chars
        data += struct.pack(order + "IIII", seconds, part, len(chars), len(chars)) + chars
    path.write_bytes(data)
    return path


def rows(sent: Sequence[Sent], serial: Serial) -> list[tuple[float, Sent]]:
    """What a program logs that reads a port: the time of the last stop bit, and the bytes."""
    return [(each.at + serial.lasts(len(each.chars)), each) for each in sent]
