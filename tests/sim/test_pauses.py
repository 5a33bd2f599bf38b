"""Pauses inside frames: each receiver decides by the rule of its protocol and device."""

from __future__ import annotations

from fractions import Fraction
from typing import Any

import pytest

from bussim.devices.free.scripted import Message
from bussim.engines.modbus.adu import Mode
from bussim.engines.modbus.gaps import GapRule
from bussim.line.characters import CharFormat, LineTiming
from bussim.line.checksums import crc16_bytes
from bussim.plc.memory import parse_device
from bussim.plc.ports.spec import FreeSpec
from bussim.scenario import fault_kinds, model
from bussim.trace.records import FrameRecord
from tests.sim import build
from tests.sim.build import MS, SECOND, Done, run
from tests.sim.serial import FREE, device, hmi, plc, poll, port, scripted, serial_bus

PLAIN = LineTiming(9600, CharFormat(8, "N", 1))
FAST = LineTiming(38400, CharFormat(8, "E", 1))
CHAR = 75_000  # ticks of a character at 9600 8N1


def asked(
    slave: str, pause: fault_kinds.Pause, timing: LineTiming = PLAIN, mode: Mode = Mode.RTU, **given: Any
) -> Done:
    """A master that asks one slave every 100 ms for a second."""
    master = hmi("panel", poll("p", 9, every=100 * MS, **given), timeout=60 * MS, timing=timing, mode=mode)
    other = device("slave", slave, station=9, timing=timing, mode=mode)
    return run(serial_bus([master, other], seconds=1, timing=timing, faults=[model.Fault("pause", pause)]))


def outcomes(done: Done) -> set[str]:
    found = {record.outcome for record in done.record.transactions}
    assert len(done.record.transactions) >= 9
    return found


def frames(done: Done, sender: str) -> list[FrameRecord]:
    return [frame for frame in done.record.frames if frame.sender == sender]


# -- Modbus RTU: the standard's 1.5 and 3.5 characters, the V80's 4.5 --------------------------------

#: Modbus over serial line, section 2.5.1.1: at 9600 in characters, above 19200 bps 750 µs and 1.75 ms.
LIMITS = [(PLAIN, CHAR * 3 // 2, CHAR * 7 // 2), (FAST, 54_000, 126_000)]


@pytest.mark.parametrize(("timing", "inside", "end"), LIMITS, ids=["9600", "38400"])
def test_a_slave_of_the_standard_takes_a_request_with_a_pause_of_so_many_characters(
    timing: LineTiming, inside: int, end: int
) -> None:
    for by, damage in (
        (1, None),
        (inside, None),
        (inside + 1, "silence inside"),
        (end - 1, "silence inside"),
    ):
        done = asked("stepper", fault_kinds.Pause("panel", by, None, 3), timing)
        assert outcomes(done) == ({"ok"} if damage is None else {"no response in time"})
        (slave,) = (each for each in done.totals.devices if each.name == "slave")
        assert slave.rejected == ({} if damage is None else {damage: len(done.record.transactions)})
    # A silence that ends a frame makes two of one: four characters with a wrong sum, and four more.
    done = asked("stepper", fault_kinds.Pause("panel", end, None, 3), timing)
    (slave,) = (each for each in done.totals.devices if each.name == "slave")
    assert outcomes(done) == {"no response in time"}
    assert slave.rejected == {"CRC or LRC wrong": 2 * len(done.record.transactions)}


@pytest.mark.parametrize("timing", [PLAIN, FAST], ids=["9600", "38400"])
def test_a_v80_takes_all_that_comes_within_its_silence_for_one_frame(timing: LineTiming) -> None:
    # V80 and PPC Modbus manual: 4.5 characters end a frame, at every rate; nothing is said of gaps inside.
    end = timing.characters(Fraction(9, 2))
    for by in (timing.characters(Fraction(16, 5)), end - 1):
        assert outcomes(asked("v80", fault_kinds.Pause("panel", by, None, 3), timing)) == {"ok"}
    assert outcomes(asked("v80", fault_kinds.Pause("panel", end, None, 3), timing)) == {"no response in time"}


def test_silences_of_a_device_are_its_own() -> None:
    rule = GapRule(Fraction(5), Fraction(5), None)
    master = hmi("panel", poll("p", 9, every=100 * MS), timeout=60 * MS)
    for by, expected in ((CHAR * 9 // 2, "ok"), (5 * CHAR, "no response in time")):
        pause = model.Fault("pause", fault_kinds.Pause("panel", by, None, 3))
        done = run(serial_bus([master, device("slave", station=9, gaps=rule)], seconds=1, faults=[pause]))
        assert outcomes(done) == {expected}


@pytest.mark.parametrize(
    ("pieces", "mode"),
    [
        ([b"\x11\x03\x00\x6b", b"\x00\x03\x76\x87"], Mode.RTU),  # V80 and PPC Modbus manual, section 2.2
        ([bytes((byte,)) for byte in b"\x11\x03\x00\x6b\x00\x03\x76\x87"], Mode.RTU),
        ([b"rubbish:1103006B", b"00037E\r\n"], Mode.ASCII),
    ],
)
def test_a_request_in_several_messages_is_no_damaged_frame(pieces: list[bytes], mode: Mode) -> None:
    at, messages = SECOND // 10, []
    for piece in pieces:
        messages.append(Message(data=piece, at=at))
        at += (len(piece) + 3) * CHAR
    sender = scripted("t", *messages)
    done = run(serial_bus([sender, device("slave", station=17, mode=mode)], seconds=1))
    (bus,) = done.totals.buses
    assert [frame.kind for frame in frames(done, "slave")] == ["response"]
    assert bus.undetected == 0
    assert not done.notes("undetected")


def test_a_request_that_is_another_by_damage_is_one() -> None:
    # 11 03 00 6B 00 03 76 87 with some bits inverted asks for register 0: its sum is right again.
    sent, other = (
        bytes.fromhex("1103006b00037687"),
        bytes.fromhex("110300000003") + crc16_bytes(bytes.fromhex("110300000003")),
    )
    flips = [10 * at + 1 + bit for at in range(8) for bit in range(8) if (sent[at] ^ other[at]) >> bit & 1]
    fault = model.Fault("flip_bits", fault_kinds.FlipBits("t", fault_kinds.Direction.TX, tuple(flips), None))
    sender = scripted("t", Message(data=sent, at=SECOND // 10))
    done = run(serial_bus([sender, device("slave", station=17)], seconds=1, faults=[fault]))
    (bus,) = done.totals.buses
    assert bus.undetected == 1
    assert [note.where for note in done.notes("undetected")] == ["slave"]


def test_a_reply_with_a_pause_is_decided_by_the_master() -> None:
    assert outcomes(asked("v80", fault_kinds.Pause("slave", CHAR * 3 // 2, None, 2))) == {"ok"}
    # "silence inside" of a response is error 1: shorter or longer than its function says.
    assert outcomes(asked("v80", fault_kinds.Pause("slave", CHAR * 3 // 2 + 1, None, 2))) == {"frame length"}


def test_a_pause_may_be_anywhere_in_the_frame_and_the_frame_is_longer_by_it() -> None:
    plain = asked("v80", fault_kinds.Pause("panel", 1, 1, 0))
    whole = frames(plain, "panel")[1]
    for index in range(7):
        done = asked("v80", fault_kinds.Pause("panel", 4 * CHAR, None, index))
        sent = frames(done, "panel")
        assert outcomes(done) == {"ok"}
        assert {frame.end - frame.start for frame in sent} == {whole.end - whole.start + 4 * CHAR}
        assert {frame.pauses for frame in sent} == {((index, 4 * CHAR),)}
    # After its last character there is nothing to pause before.
    done = asked("v80", fault_kinds.Pause("panel", 10 * CHAR, None, 7))
    assert outcomes(done) == {"ok"}
    assert {frame.pauses for frame in frames(done, "panel")} == {()}


def test_a_count_counts_the_frames_that_pause() -> None:
    # Eight characters of a request have a ninth never; the reply of nine has.
    done = asked("v80", fault_kinds.Pause("slave", 4 * CHAR, 3, 7), count=2)
    assert [len(frame.chars) for frame in frames(done, "slave")][:1] == [9]
    assert [bool(frame.pauses) for frame in frames(done, "slave")].count(True) == 3
    assert [record.outcome for record in done.record.transactions][:4] == ["frame length"] * 3 + ["ok"]
    short = asked("v80", fault_kinds.Pause("slave", 4 * CHAR, 3, 7), count=1)
    assert outcomes(short) == {"ok"}


def test_without_an_index_a_pause_comes_anywhere_but_at_the_end() -> None:
    done = asked("v80", fault_kinds.Pause("slave", 4 * CHAR, None), count=5)
    found = {frame.pauses[0][0] for frame in frames(done, "slave")}
    assert all(len(frame.pauses) == 1 for frame in frames(done, "slave"))
    assert found <= set(range(14))
    assert len(found) > 3


def test_two_pauses_add_up() -> None:
    faults = [
        model.Fault(f"f{n}", fault_kinds.Pause("panel", by, None, 3)) for n, by in enumerate((MS, 2 * MS))
    ]
    faults.append(model.Fault("other", fault_kinds.Pause("panel", MS, None, 5)))
    master = hmi("panel", poll("p", 9, every=100 * MS), timeout=60 * MS)
    done = run(serial_bus([master, device("slave", station=9)], seconds=1, faults=faults))
    assert {frame.pauses for frame in frames(done, "panel")} == {((3, 3 * MS), (5, MS))}


# -- ASCII, N:N, free protocol -----------------------------------------------------------------------


def test_ascii_allows_a_second() -> None:
    ascii_line = LineTiming(9600, CharFormat(7, "E", 1))

    def done(by: int) -> set[str]:
        master = hmi(
            "panel", poll("p", 9, every=5 * SECOND), timeout=3 * SECOND, timing=ascii_line, mode=Mode.ASCII
        )
        slave = device("slave", station=9, timing=ascii_line, mode=Mode.ASCII)
        fault = model.Fault("pause", fault_kinds.Pause("panel", by, None, 6))
        found = run(serial_bus([master, slave], seconds=9, timing=ascii_line, faults=[fault]))
        return {record.outcome for record in found.record.transactions}

    assert done(SECOND - 1) == {"ok"}
    assert done(SECOND) == {"no response in time"}


def test_two_characters_end_a_frame_of_the_link() -> None:
    plain = run(build.link(3, 1, seconds=1))
    two = 2 * build.CHAR
    short = run(build.link(3, 1, seconds=1, faults=[fault_kinds.Pause("p1", two - 1, None, 4)]))
    assert short.record.failures == []
    # Every link scan is longer by the pause.
    longer = short.record.scans[3].duration - plain.record.scans[3].duration
    assert longer == two - 1
    # Two characters: damage, and the attempt is over with them. The rest collides with the next poll.
    done = run(build.link(3, 1, seconds=1, retries=0, faults=[fault_kinds.Pause("p1", two, None, 4)]))
    assert set(done.link.failed_attempts[1]) == {4}
    first = next(attempt for attempt in done.record.attempts if attempt.station == 1)
    reply, next_poll = done.of("p1")[0], next(f for f in done.of("p0", "poll") if f.station == 2)
    assert first.end == reply.start + 5 * build.CHAR + two
    assert (reply.collided, next_poll.collided) == (True, True)


def test_a_master_of_the_link_that_pauses_is_damaged_to_its_slaves() -> None:
    pause = build.fault(fault_kinds.Pause("p0", 3 * build.CHAR, None, 2), at=1.0)
    done = run(build.link(3, 1, seconds=1.19, retries=0, units=10, faults=[pause]))
    assert all(frame.start < 1.01 * SECOND for frame in (*done.of("p1"), *done.of("p2")))
    assert {code for _, code in done.codes} == {1}
    # Damage of the master's counts once until it is understood again.
    assert done.about("p1", 0) == (1, 0x14, 1)


def test_a_message_with_a_pause_is_one_while_the_timeout_lasts() -> None:
    spec = FreeSpec("scan", "COM3", device=parse_device("D300"), count=8)

    def received(by: int) -> list[tuple[bytes, str]]:
        reader = scripted("reader", Message(b"ABCDEFGH", at=100 * MS))
        box = plc("box", port("COM3", FREE, timeout=5), polls=[spec])
        faults = [model.Fault("f", fault_kinds.Pause("reader", by, None, 3))]
        found = run(serial_bus([reader], [box], seconds=1, faults=faults))
        return [
            (each.data, each.ended) for each in found.record.said if each.node == "box.COM3" and each.data
        ]

    assert received(40 * MS) == [(b"ABCDEFGH", "all bytes are there")]
    assert received(60 * MS)[0] == (b"ABCD", "timeout")
