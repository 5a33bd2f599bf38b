"""Other people's decoders on what a real simulated run exports: noise, writes, exceptions, jabber."""

from __future__ import annotations

from bisect import bisect_left
from collections import Counter
from pathlib import Path

import pytest

import bussim
from bussim.export.packets import script
from bussim.line.characters import CharFormat
from bussim.scenario.loader import loads
from bussim.trace.file import Trace
from bussim.trace.records import FrameRecord
from bussim.units import TICKS_PER_SECOND, TICKS_PER_US
from tests.checksums import crc_by_definition
from tests.export.peers import CRC, RTU_SERIAL, RTU_UDP, number, sigrok, tshark
from tests.export.samples import exported, timing

SCENARIO = """\
schema: 1
name: 'ofen & presse <1> / "linie" ü'
duration: 12 s
seed: 5
buses: [{name: link, nn: true}, {name: oven, baud: 19200, format: 8E1}]
plcs:
  - name: press1
    scan: {mean: 8 ms, jitter: 1 ms}
    nn: {bus: link, port: COM4, station: 0, slaves: 1, mode: 2, retries: 3, timeout: 50 ms}
    ports: {COM3: {bus: oven, protocol: modbus-rtu-master, timeout: 100 ms}}
    polls:
      - {port: COM3, station: 2, function: 3, address: 0, count: 8, to: D500, retries: 1}
      - {port: COM3, station: 2, function: 0x10, address: 0, count: 8, from: D0, every: 300 ms}
      - {port: COM3, station: 2, function: 3, address: 900, count: 2, to: D600, every: 500 ms}
      - {port: COM3, station: 0, function: 6, address: 3, values: [78], count: 1, every: 700 ms}
    sources: {D0: {counter: 30 ms}, M1000: {toggle: 500 ms}}
  - {name: press2, nn: {bus: link, port: COM4, station: 1}, sources: {D32: {counter: 30 ms}}}
devices:
  - name: oven1
    model: map
    bus: oven
    station: 2
    functions: [3, 4, 6, 0x10]
    registers: [{address: 0, count: 8, value: 2150, writable: true}]
noise: [{bus: link, ber: 3.0e-5}, {bus: oven, ber: 2.0e-4}]
faults: [{at: 10 s, for: 200 ms, jabber: press2}]
"""
#: Before the jabber, whose characters lie one upon another.
UNTIL = 9_900 * TICKS_PER_SECOND // 1000
UART = {
    "link": "baudrate=38400:data_bits=7:parity=even:stop_bits=1.0",
    "oven": "baudrate=19200:data_bits=8:parity=even:stop_bits=1.0",
}


@pytest.fixture(scope="module")
def run() -> Trace:
    return bussim.run(loads(SCENARIO), trace=True).open_trace()


def on(run: Trace, bus: str) -> list[FrameRecord]:
    return sorted(run.of(FrameRecord, bus=bus), key=lambda each: each.start)


def flipped(one: FrameRecord) -> bytes | None:
    """The characters with their damaged data bits; None where a start or stop bit is damaged as well."""
    form = CharFormat.parse(one.format)
    chars = bytearray(one.chars)
    for bit in one.damaged_bits:
        index, within = divmod(bit, form.bits)
        if within == 0 or within == form.bits - 1:
            return None
        if within <= form.data_bits:
            chars[index] ^= 1 << within - 1
    return bytes(chars)


@pytest.mark.parametrize("encapsulation", ["serial", "udp"])
def test_tshark_reads_the_oven_and_checks_every_crc(run: Trace, tmp_path: Path, encapsulation: str) -> None:
    path = exported(run, tmp_path / "a.pcapng", "pcapng", encapsulation=encapsulation, bus="oven")
    udp = encapsulation == "udp"
    fields = ["mbrtu.unit_id", "mbrtu.crc16.status", "modbus.func_code", "modbus.exception_code"]
    fields += ["modbus.regval_uint16", "frame.comment"]
    rows = tshark(path, fields, [*(RTU_UDP if udp else RTU_SERIAL), *CRC])
    frames = on(run, "oven")
    good = bad = exceptions = 0
    for one, row in zip(frames, rows, strict=True):
        assert bool(row["frame.comment"]) is bool(one.damaged_bits)
        chars = flipped(one)
        if chars is None or (chars[0] == 0 and not udp):
            continue  # on a serial line Wireshark takes no broadcast
        status = number(row["mbrtu.crc16.status"])
        if crc_by_definition(chars[:-2]) != int.from_bytes(chars[-2:], "little"):
            bad += status == 0
            assert status != 1
            continue
        good += 1
        assert status == 1
        assert number(row["mbrtu.unit_id"]) == chars[0]
        assert number(row["modbus.func_code"]) == chars[1] & 0x7F
        if chars[1] & 0x80:
            exceptions += 1
            assert number(row["modbus.exception_code"]) == chars[2]
        elif one.kind == "response" and chars[1] == 3:
            words = [int.from_bytes(chars[at : at + 2], "big") for at in range(3, len(chars) - 2, 2)]
            assert list(map(int, row["modbus.regval_uint16"])) == words
    assert good > 400
    assert bad > 5
    assert exceptions > 10


def test_the_dissector_reads_the_link_and_checks_every_sum(run: Trace, tmp_path: Path) -> None:
    path = exported(run, tmp_path / "a.pcapng", "pcapng", bus="link")
    fields = ["nn.kind", "nn.station", "nn.counter", "nn.data", "nn.sum.status", "frame.comment"]
    rows = tshark(path, fields, ["-X", f"lua_script:{script('nn.lua')}"])
    # Of frames that overlap the packets are what has no silence in it, each with its comment.
    sound = [row for row in rows if not row["frame.comment"]]
    frames = [one for one in on(run, "link") if one.kind != "jabber"]
    clean = [one for one in frames if not (one.damaged_bits or one.collided or one.cut)]
    for one, row in zip(clean, sound, strict=True):
        assert row["nn.kind"] == [one.kind]
        assert (number(row["nn.station"]), number(row["nn.counter"])) == (one.station, one.counter)
        assert number(row["nn.sum.status"]) == 1
        if one.kind == "data":
            assert row["nn.data"] == [one.chars[3:-3].decode().lower()]
    assert len(clean) > 900
    assert len(frames) - len(clean) > 8
    assert len(frames) < len(on(run, "link"))


@pytest.mark.slow
@pytest.mark.parametrize("to", ["vcd", "sr"])
@pytest.mark.parametrize("bus", ["link", "oven"])
def test_uart_reads_every_character_and_flags_every_parity_error(
    run: Trace, tmp_path: Path, bus: str, to: str
) -> None:
    path = exported(run, tmp_path / f"a.{to}", to, bus=bus, start=0, stop=UNTIL)
    values = sigrok(path, f"uart:rx={bus}:{UART[bus]}:format=hex", "uart=rx-data")
    wrong = sigrok(path, f"uart:rx={bus}:{UART[bus]}", "uart=rx-parity-err")
    frames = [one for one in on(run, bus) if one.end <= UNTIL]
    framing = flags = 0
    for one in frames:
        chars = flipped(one)
        half = timing(one.baud, one.format).characters(1) // 2
        begin, end = (tick // TICKS_PER_US for tick in (one.start - half, one.end + half))
        if chars is None:
            framing += 1  # how a receiver goes on after a wrong start or stop bit is its own affair
            continue
        read = values[bisect_left(values, (begin,)) : bisect_left(values, (end,))]
        assert bytes(int(text, 16) for _, _, text in read) == chars
        hits = Counter(bit // CharFormat.parse(one.format).bits for bit in one.damaged_bits)
        odd = sum(count % 2 for count in hits.values())
        flags += odd
        assert bisect_left(wrong, (end,)) - bisect_left(wrong, (begin,)) == odd
    assert flags > 4
    assert framing < len(frames) / 50
