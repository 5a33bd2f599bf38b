"""Made-up traces: frames of every protocol, whole and damaged, from seeded generators."""

from __future__ import annotations

import random
from collections.abc import Iterable, Sequence
from fractions import Fraction
from pathlib import Path

from bussim.engines.modbus.adu import Mode, encode_adu
from bussim.engines.modbus.pdu import (
    Request,
    Response,
    encode_exception,
    encode_request,
    encode_response,
    write_coil,
    write_coils,
    write_register,
    write_registers,
)
from bussim.engines.nn.frames import MODES, LinkSettings, encode_data, encode_parameters, encode_poll
from bussim.export.formats import export_trace
from bussim.line.characters import CharFormat, LineTiming
from bussim.line.protocols import BusProtocol
from bussim.trace.file import Trace, trace_of
from bussim.trace.records import FrameRecord, Record, TraceBus, TraceHeader
from bussim.units import TICKS_PER_MS

LINK = TraceBus(
    "link",
    BusProtocol.NN,
    38400,
    "7E1",
    ("press1", "press2", "press3"),
    {"press1": 0, "press2": 1, "press3": 2},
)
FEEDER = TraceBus("feeder", BusProtocol.SERIAL, 9600, "8N1", ("press1.COM3", "feeder1"), {"feeder1": 17})
OVEN = TraceBus("oven", BusProtocol.SERIAL, 19200, "8E1", ("press2.COM5", "oven1"), {"oven1": 2})
PUMPS = TraceBus("pumps", BusProtocol.SERIAL, 9600, "7E1", ("station.COM3", "pump1"), {"pump1": 6})
GATE = TraceBus("gate", BusProtocol.SERIAL, 9600, "8N1", ("sorter.COM3", "reader1"), {})
BUSES = {bus.name: bus for bus in (LINK, FEEDER, OVEN, PUMPS, GATE)}


def timing(baud: int, fmt: str, ppm: float = 0.0) -> LineTiming:
    return LineTiming(baud, CharFormat.parse(fmt), Fraction(repr(ppm)))


def frame(
    bus: TraceBus,
    start: int,
    sender: str,
    chars: bytes,
    *,
    kind: str = "data",
    station: int | None = None,
    counter: int | None = None,
    damaged: Iterable[int] = (),
    damaged_at: dict[str, tuple[int, ...]] | None = None,
    collided: bool = False,
    cut_to: int | None = None,
    protocol: str | None = None,
    baud: int | None = None,
    fmt: str | None = None,
    ppm: float = 0.0,
) -> FrameRecord:
    """A frame; its end follows from its characters, or it is cut off after so many ticks."""
    own = timing(baud or bus.baud, fmt or bus.format, ppm)
    length = own.bits(len(chars) * own.format.bits)
    return FrameRecord(
        bus=bus.name,
        start=start,
        end=start + (length if cut_to is None else cut_to),
        sender=sender,
        kind=kind,
        station=station,
        counter=counter,
        chars=chars,
        damaged_bits=tuple(damaged),
        damaged_at=damaged_at or {},
        collided=collided,
        cut=cut_to is not None,
        protocol=protocol or ("nn" if bus.protocol is BusProtocol.NN else "modbus-rtu"),
        baud=own.baud,
        format=str(own.format),
        ppm=ppm,
    )


def trace(*records: Record, buses: Sequence[TraceBus] = (LINK,), seed: int | None = 7) -> Trace:
    return trace_of(TraceHeader(tuple(buses), "three presses", seed, None), records)


def exported(trace: Trace, path: Path, to: str, **choices: object) -> Path:
    export_trace(trace, path, to, **choices)  # type: ignore[arg-type]
    return path


def bits_of(one: FrameRecord) -> int:
    """Bits of a frame on the wire."""
    return len(one.chars) * CharFormat.parse(one.format).bits


def link_frames(count: int, seed: int = 1, *, mode: int = 2, damage: float = 0.0) -> list[FrameRecord]:
    """N:N frames one after the other; some of them with one to three damaged bits."""
    chance = random.Random(seed)
    found: list[FrameRecord] = []
    now, counter = 3 * TICKS_PER_MS, 0
    while len(found) < count:
        settings = LinkSettings(2, mode, chance.randrange(11), chance.randrange(5, 226))
        turn = [(encode_parameters(counter, settings), 0)] if chance.random() < 0.2 else []
        turn.append((encode_data(0, counter, chance.randbytes(MODES[mode].size)), 0))
        for station in (1, 2):
            turn.append((encode_poll(station, counter), 0))
            turn.append((encode_data(station, counter, chance.randbytes(MODES[mode].size)), station))
        for coded, sender in turn:
            one = frame(
                LINK,
                now,
                LINK.nodes[sender],
                coded.chars,
                kind=coded.kind_name,
                station=coded.station,
                counter=coded.counter,
            )
            if chance.random() < damage:
                hit = sorted(chance.sample(range(bits_of(one)), chance.randint(1, 3)))
                one = one._replace(damaged_bits=tuple(hit))
            found.append(one)
            now = one.end + chance.randrange(30_000, 60_000)
        counter = (counter + 1) % 16
    return found[:count]


class Exchange:
    """A request and what came back (None: nothing, of a broadcast)."""

    def __init__(self, request: Request, station: int, response: bytes | None) -> None:
        self.request = request
        self.station = station
        self.response = response
        self.frames: list[FrameRecord] = []


def exchanges(count: int, seed: int = 1, *, mode: Mode = Mode.RTU, bus: TraceBus = OVEN) -> list[Exchange]:
    """Modbus exchanges of every function, exceptions and broadcasts, one after the other on a bus."""
    chance = random.Random(seed)
    (slave,) = bus.stations.values()
    master, server = bus.nodes
    protocol = f"modbus-{mode.value}"
    now = 5 * TICKS_PER_MS
    found: list[Exchange] = []
    for number in range(count):
        request = _request(chance, number)
        station = 0 if request.function in (5, 6, 15, 16) and chance.random() < 0.2 else slave
        response: bytes | None = None
        if station:
            refused = chance.random() < 0.15
            response = (
                encode_exception(request.function, chance.randint(1, 4))
                if refused
                else _response(chance, request)
            )
        each = Exchange(request, station, response)
        sent = [(master, "request", encode_request(request))]
        if response is not None:
            sent.append((server, "response", response))
        for sender, kind, pdu in sent:
            chars = encode_adu(mode, station, pdu).chars
            one = frame(bus, now, sender, chars, kind=kind, station=station, protocol=protocol)
            each.frames.append(one)
            now = one.end + chance.randrange(5 * TICKS_PER_MS, 9 * TICKS_PER_MS)
        found.append(each)
    return found


def _request(chance: random.Random, number: int) -> Request:
    function = (1, 2, 3, 4, 5, 6, 15, 16)[number % 8]
    address = chance.randrange(60_000)
    if function <= 2:
        return Request(function, address, chance.randint(1, 40))
    if function <= 4:
        return Request(function, address, chance.randint(1, 12))
    if function == 5:
        return write_coil(address, on=chance.random() < 0.5)
    if function == 6:
        return write_register(address, chance.randrange(65536))
    if function == 15:
        return write_coils(address, [chance.randrange(2) for _ in range(chance.randint(1, 20))])
    return write_registers(address, [chance.randrange(65536) for _ in range(chance.randint(1, 9))])


def _response(chance: random.Random, request: Request) -> bytes:
    values = request.values
    if request.function <= 2:
        values = tuple(chance.randrange(2) for _ in range(request.quantity))
    elif request.function <= 4:
        values = tuple(chance.randrange(65536) for _ in range(request.quantity))
    return encode_response(Response(request.function, request.address, request.quantity, values))
