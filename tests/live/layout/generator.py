"""Recordings of polled links in other layouts, and their truth: nothing of it is bussim's.

A link at 38400 7E1 is played through in plain numbers: the master's data frame, then each station polled until it
replies or its attempts are spent. What stands in the frames is made by small functions, one a layout.
"""

from __future__ import annotations

import random
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import reduce
from operator import xor

from tests.checksums import crc_by_definition

CHARACTER = 10 / 38400
GAP = 0.0004175
OVERHEAD = 0.00352
TIMEOUT = 0.1


@dataclass(frozen=True)
class Made:
    """A layout: how each kind of frame is built of station, scan number and data."""

    data: Callable[[int, int, bytes], bytes]
    poll: Callable[[int, int], bytes]
    parameters: Callable[[int, tuple[int, int, int, int]], bytes]


@dataclass
class Truth:
    """What is on the line."""

    rows: list[tuple[float, bytes]] = field(default_factory=list)  # end of each frame, in seconds
    scans: list[float] = field(default_factory=list)  # milliseconds
    attempts: dict[int, int] = field(default_factory=dict)
    lost: dict[int, int] = field(default_factory=dict)  # attempts without a reply
    damaged: dict[int, int] = field(default_factory=dict)  # attempts whose reply was damaged
    frames: int = 0
    visible: int = 0  # frames of which some value is wrong: a text has no parity
    open: int = 0  # the station that is polled last, if no reply came before the end

    @property
    def mean_scan(self) -> float:
        """The mean link scan time, ms."""
        return sum(self.scans) / len(self.scans)

    @property
    def decided(self) -> dict[int, int]:
        """Attempts by station without the one that is open at the end."""
        return {station: count - (station == self.open) for station, count in self.attempts.items()}

    @property
    def text(self) -> str:
        """The recording."""
        return "".join(f"{at:.9f} {chars.hex()}\n" for at, chars in self.rows)


def recorded(
    made: Made,
    *,
    slaves: int = 1,
    size: int = 24,
    seconds: float = 5.0,
    retries: int = 3,
    dead: tuple[int, ...] = (),
    ber: float = 0.0,
    loss: float = 0.0,
    seed: int = 1,
    values: int = 1000,
) -> Truth:
    """A recording of a link of so many slaves with ``size`` bytes of data in a frame.

    ``dead`` stations never reply; ``loss`` is the chance that a reply does not come. ``values`` is the number of
    values that the data's words take: counters that go on.
    """
    rng = random.Random(seed)
    truth = Truth()
    now = 0.006
    words = [[rng.randrange(values) for _ in range(size // 2)] for _ in range(slaves + 1)]

    def data(station: int) -> bytes:
        if rng.random() < 0.6:
            at = rng.randrange(size // 2)
            words[station][at] = (words[station][at] + 1) % 65536
        return b"".join(word.to_bytes(2, "big") for word in words[station])

    def send(chars: bytes) -> tuple[float, bool]:
        """Put a frame on the line; whether it is whole."""
        nonlocal now
        start, seen, whole = now, bytearray(chars), True
        for at in range(len(seen)):
            if ber and rng.random() < 1 - (1 - ber) ** 10:
                whole = False
                bit = rng.randrange(10)
                if bit < 7:  # start, stop and parity bits leave the value
                    seen[at] ^= 1 << bit
        now += len(chars) * CHARACTER
        truth.rows.append((now, bytes(seen)))
        truth.frames += 1
        truth.visible += bytes(seen) != chars
        return start, whole

    send(made.parameters(0, (slaves, 2, retries, 10)))
    now += GAP
    scan, begun = 0, None
    flagged = False
    while now < seconds:
        if flagged:
            send(made.parameters(scan, (slaves, 2, retries, 10)))
            now += GAP
        flagged = False
        start, _ = send(made.data(0, scan, data(0)))
        if begun is not None:
            truth.scans.append(1000 * (start - begun))
        begun = start
        for station in range(1, slaves + 1):
            for attempt in range(retries + 1):
                now += GAP
                _, heard = send(made.poll(station, scan))
                truth.attempts[station] = truth.attempts.get(station, 0) + 1
                if not heard or station in dead or rng.random() < loss:
                    truth.lost[station] = truth.lost.get(station, 0) + 1
                    now += TIMEOUT
                    truth.open = station
                    flagged = flagged or attempt == retries
                    continue
                now += GAP + rng.uniform(-0.0001, 0.0001)
                _, whole = send(made.data(station, scan, data(station)))
                truth.open = 0
                if whole:
                    break
                truth.damaged[station] = truth.damaged.get(station, 0) + 1
                now += 2 * CHARACTER
                flagged = flagged or attempt == retries
        now += GAP + OVERHEAD
        scan += 1
    if truth.open:
        truth.lost[truth.open] -= 1
    truth.lost = {station: count for station, count in truth.lost.items() if count}
    return truth


# -- layouts -----------------------------------------------------------------------------------


def _h(number: int, size: int = 2) -> bytes:
    return f"{number:0{size}X}".encode()


def _add(chars: bytes) -> bytes:
    return _h(sum(chars) % 256)


def _text(chars: bytes) -> bytes:
    return chars.hex().upper().encode()


def assumed() -> Made:
    """The assumed layout."""
    return _plain()


def _plain(
    *,
    heads: tuple[bytes, bytes, bytes] = (b"\x02", b"\x05", b"\x01"),
    etx: bytes = b"\x03",
    tail: bytes = b"",
    station: Callable[[int], bytes] = lambda k: _h(k, 1),
    counter: Callable[[int], bytes] = lambda n: _h(n % 16, 1),
    check: Callable[[bytes], bytes] = _add,
    covered: Callable[[bytes, bytes, bytes], bytes] = lambda _, body, etx: body + etx,
    digits: Callable[[bytes], bytes] = _text,
    settings: Callable[[bytes], bytes] = _text,
    swapped: bool = False,
) -> Made:
    """Layouts of the usual order; each argument is one thing that may differ."""

    def sealed(head: bytes, body: bytes, end: bytes) -> bytes:
        return head + body + end + check(covered(head, body, end)) + tail

    def where(k: int, n: int) -> bytes:
        return counter(n) + station(k) if swapped else station(k) + counter(n)

    return Made(
        data=lambda k, n, data: sealed(heads[0], where(k, n) + digits(data), etx),
        poll=lambda k, n: sealed(heads[1], where(k, n), b""),
        parameters=lambda n, given: sealed(heads[2], b"F" + counter(n) + settings(bytes(given)), etx),
    )


def counted_to(counts: int) -> Made:
    """The assumed layout with a counter that begins again after so many scans."""
    return _plain(counter=lambda n: _h(n % counts, 1))


def _low_first(data: bytes) -> bytes:
    return _text(b"".join(data[at : at + 2][::-1] for at in range(0, len(data), 2)))


#: Layouts that differ from the assumed one, by what differs.
ALTERED: dict[str, Made] = {
    "sum without end character": _plain(covered=lambda _, body, __: body),
    "sum with header": _plain(covered=lambda head, body, etx: head + body + etx),
    "two's complement": _plain(check=lambda chars: _h(-sum(chars) % 256)),
    "exclusive or": _plain(check=lambda chars: _h(reduce(xor, chars, 0))),
    "CRC, low byte first": _plain(check=lambda chars: _text(crc_by_definition(chars).to_bytes(2, "little"))),
    "other headers, ends with CR LF": _plain(heads=(b"#", b"?", b"!"), etx=b"", tail=b"\r\n"),
    "binary station": _plain(station=lambda k: bytes((k,))),
    "station from 1 with two digits": _plain(station=lambda k: f"{k + 1:02d}".encode()),
    "no counter": _plain(counter=lambda _: b""),
    "two-digit counter": _plain(counter=lambda n: _h(n % 256)),
    "decimal counter before the station": _plain(counter=lambda n: f"{n % 100:02d}".encode(), swapped=True),
    "lower case, sum of bytes": _plain(
        digits=lambda data: data.hex().encode(),
        settings=lambda data: data.hex().encode(),
        check=lambda chars: f"{-sum(chars) % 256:02x}".encode(),
        counter=lambda n: f"{n % 256:02x}".encode(),
        station=lambda k: b"%02x" % k,
    ),
    "binary data and sum": _plain(
        heads=(b"\xaa", b"\xa5", b"\xa1"),
        etx=b"",
        station=lambda k: bytes((k,)),
        counter=lambda n: bytes((n % 256,)),
        digits=lambda data: data,
        settings=lambda data: data,
        check=lambda chars: crc_by_definition(chars).to_bytes(2, "little"),
        covered=lambda head, body, _: head + body,
    ),
    "low byte of words first": _plain(digits=_low_first),
}
