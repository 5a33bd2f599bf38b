"""Frames, damage, strays and outcomes of lines whose truth is known."""

from __future__ import annotations

import random
from pathlib import Path
from typing import Any

import pytest

from bussim.line.characters import CharFormat, LineTiming
from bussim.live.arrival import placed
from bussim.live.sniff.heard import LineProtocol
from bussim.live.sniff.listener import Listener
from bussim.results.collector import Collector
from bussim.units import TICKS_PER_SECOND
from tests.live.recordings.generator import (
    Sent,
    Serial,
    ascii_frame,
    crc,
    modbus,
    nn_link,
    pair,
    rtu,
    sigrok,
    wave,
)
from tests.live.recordings.reading import ok, sniffed
from tests.selection import quick

SERIAL = Serial(9600, 8, "E", 1)
RATE = 96_000


def listened(frames: list[tuple[float, bytes]], timing: LineTiming, **options: Any) -> Listener:
    listener = Listener("b", timing, Collector(), LineProtocol.RTU, **options)
    for at, chars in frames:
        listener.chars(placed(chars, round(at * TICKS_PER_SECOND), timing))
    listener.close()
    return listener


@pytest.mark.parametrize("count", [4_000, pytest.param(100_000, marks=pytest.mark.slow)])
@pytest.mark.parametrize("tolerance", [0, TICKS_PER_SECOND // 50])
def test_no_request_is_seen_in_responses_with_a_right_crc_inside(count: int, tolerance: int) -> None:
    """Of the responses of two registers one in 256 has one after eight characters."""
    rng = random.Random(8)
    timing = LineTiming(115200, CharFormat(8, "N", 1))
    request = rtu(1, 3, 0, 0, 0, 2)
    frames, inner = [], 0
    for number in range(count):
        data = rng.randbytes(4)
        if number % 20 == 0:  # the seventh character is the low one of the CRC before it
            data = data[:3] + crc(bytes((1, 3, 4)) + data[:3])[:1]
        response = rtu(1, 3, 4, data)
        inner += crc(response[:6]) == response[6:8]
        frames += [(number * 0.01, request), (number * 0.01 + 0.003, response)]
    assert inner >= count // 20
    decoder = listened(frames, timing, exact=not tolerance, tolerance=tolerance).decoder
    assert decoder.outcomes == {"ok": count}
    assert (decoder.frames, decoder.damaged, decoder.unasked, decoder.strays) == (2 * count, 0, 0, 0)


def strays(sent: list[Sent], serial: Serial, share: float, seed: int) -> tuple[list[Sent], int]:
    """Lone characters behind frames, as drivers leave that switch off."""
    rng = random.Random(seed)
    found = [
        Sent(
            each.at + serial.lasts(len(each.chars)) + 0.4 / serial.baud * serial.bits,
            bytes((0xFF & (1 << serial.data) - 1,)),
        )
        for each in sent
        if rng.random() < share
    ]
    return sorted([*sent, *found]), len(found)


@pytest.mark.parametrize("share", [0.1, 1.0])
@pytest.mark.parametrize("kind", ["rtu", "nn", "text"])
def test_strays_change_nothing(kind: str, share: float, tmp_path: Path) -> None:
    serial = Serial(38400, 7, "E", 1) if kind == "nn" else SERIAL
    sent = nn_link(serial, 20) if kind == "nn" else modbus(serial, 40, 5, lost=0.1)[0]
    both = []
    for number, (each, _) in enumerate([(sent, 0), strays(sent, serial, share, 2)]):
        if kind == "text":
            path = tmp_path / f"{number}.txt"
            lines = [f"{one.at + serial.lasts(len(one.chars)):.6f} {one.chars.hex()}" for one in each]
            path.write_text("\n".join(lines), encoding="utf-8")
            both.append(sniffed(path, "-b", "9600", "-P", "even"))
        else:
            rate = 10 * serial.baud
            both.append(sniffed(sigrok(tmp_path / f"{number}.sr", rate, {"D0": wave(each, serial, rate)})))
    plain, with_strays = both
    assert with_strays["strays"] == with_strays["stray_characters"] == strays(sent, serial, share, 2)[1]
    keys = ("protocol", "frames", "damaged", "unasked", "outcomes", "exchanges", "link", "scans_unmeasured")
    assert {key: with_strays.get(key) for key in keys} == {key: plain.get(key) for key in keys}


def test_damage_is_counted_once_and_named(tmp_path: Path) -> None:
    request, response = rtu(1, 3, 0, 0, 0, 2), rtu(1, 3, 4, bytes(4))
    at, sent = 0.05, []
    for shown in (
        response,
        response[:-1] + b"\x00",  # CRC
        response[:5],  # cut off
        response[:1],  # a lone character
        b"",
        response,
    ):
        sent += [Sent(at, request), *([Sent(at + 0.02, shown, 1)] if shown else [])]
        at += 0.1
    found = sniffed(sigrok(tmp_path / "line.sr", RATE, {"D0": wave(sent, SERIAL, RATE)}))
    assert (found["frames"], found["damaged"], found["strays"]) == (10, 2, 1)
    assert found["outcomes"] == {"ok": 2, "damaged": 2, "no_answer": 2}
    assert found["exchanges"]["1: 03 at 0 × 2"]["outcomes"] == found["outcomes"]


KINDS = {
    "modbus-rtu": (Serial(9600, 8, "E", 1), lambda serial, seed: modbus(serial, 60, seed)[0]),
    "nn": (Serial(38400, 7, "E", 1), lambda serial, seed: nn_link(serial, 38 + seed)),
    "modbus-ascii": (
        Serial(9600, 7, "E", 1),
        lambda serial, seed: modbus(serial, 60, seed, frame=ascii_frame)[0],
    ),
    "without parity": (Serial(19200, 8, "N", 1), lambda serial, seed: modbus(serial, 60, seed)[0]),
}


@pytest.mark.parametrize(("kind", "seed"), quick(4, [(kind, seed) for seed in range(12) for kind in KINDS]))
def test_each_frame_with_wrong_bits_is_one_damaged_frame(kind: str, seed: int, tmp_path: Path) -> None:
    serial, sent_on = KINDS[kind]
    rng = random.Random(seed)
    ber = 10 ** rng.uniform(-4, -2.7)
    sent = [
        each._replace(flips=tuple(b for b in range(len(each.chars) * serial.bits) if rng.random() < ber))
        for each in sent_on(serial, seed)
    ]
    rate = rng.choice([8, 10, 13]) * serial.baud
    found = sniffed(sigrok(tmp_path / "line.sr", rate, {"D0": wave(sent, serial, rate)}))
    damaged = sum(bool(each.flips) for each in sent)
    assert found["format"] == serial.name
    assert found["frames"] == pytest.approx(len(sent), abs=1)
    assert found["damaged"] == pytest.approx(damaged, abs=max(1, damaged // 50))
    assert found["strays"] == 0


@pytest.mark.parametrize("seed", quick(6, range(60)))
def test_what_the_ends_cut_is_neither_damage_nor_a_stray(seed: int, tmp_path: Path) -> None:
    rng = random.Random(seed)
    serial, sent_on = KINDS[["nn", "modbus-ascii", "modbus-rtu"][seed % 3]]
    sent, rate = sent_on(serial, seed), 10 * serial.baud
    level = wave(sent, serial, rate)
    first, last = rng.randrange(rate // 20, len(level) // 3), rng.randrange(2 * len(level) // 3, len(level))
    inside = [
        each
        for each in sent
        if each.at * rate >= first and (each.at + serial.lasts(len(each.chars))) * rate <= last
    ]
    found = sniffed(sigrok(tmp_path / "line.sr", rate, {"D0": level[first:last]}))
    assert found["strays"] == 0
    # In RTU any characters may begin as a frame does.
    assert found["damaged"] <= (seed % 3 == 2)
    assert found["frames"] - found["damaged"] == len(inside)


def lumped(sent: list[tuple[float, bytes]], serial: Serial, every: float, phase: float) -> str:
    """What an adapter hands over every so many seconds: all characters that have come."""
    lumps: dict[int, bytearray] = {}
    for at, chars in sent:
        for index, value in enumerate(chars):
            lumps.setdefault(-int((phase - at - serial.lasts(index + 1)) // every), bytearray()).append(value)
    return "\n".join(f"{phase + at * every:.6f} {chars.hex(' ')}" for at, chars in sorted(lumps.items()))


@pytest.mark.parametrize("seed", quick(8, range(100)))
def test_lumps_of_an_adapter(seed: int, tmp_path: Path) -> None:
    """Request and response may come in one lump, a frame in two; with echoes and without."""
    rng = random.Random(seed)
    serial = Serial(rng.choice([9600, 19200]), 8, "N", 1)
    echo, lost = rng.random() < 0.3, rng.choice([0, 0, 0.1])
    asked = [[rtu(1 + number % 2, pdu) for pdu in pair(rng)] for number in range(6)]
    sent, frames, answered = [], 0, 0
    delay = rng.uniform(0.005, 0.02)
    for number in range(60):
        at, (request, response) = 0.1 + 0.15 * number, asked[number % 6]
        end = at + serial.lasts(len(request))
        sent.append((at, request))
        if echo:
            sent.append((end + 0.0001, request))
            end += 0.0001 + serial.lasts(len(request))
        frames += 1
        if rng.random() >= lost or number == 59:
            sent.append((end + delay * rng.uniform(0.9, 1.1), response))
            frames, answered = frames + 1, answered + 1
    path = tmp_path / "line.txt"
    every = rng.choice([0.016, 0.004, 0.001])
    path.write_text(lumped(sent, serial, every, rng.random() * every), encoding="utf-8")
    found = sniffed(path, "-b", str(serial.baud), "-P", "none")
    assert (found["frames"], found["damaged"], found["strays"]) == (frames, 0, 0)
    assert (ok(found), found["echoes"]) == (answered, 60 * echo)
    assert found["outcomes"].get("no_answer", 0) == 60 - answered


def test_a_frame_with_a_silence_inside_is_one_damaged_frame() -> None:
    timing = LineTiming(9600, CharFormat(8, "N", 1))
    request = rtu(1, 3, 0, 0, 0, 2)
    listener = Listener("b", timing, Collector(), LineProtocol.RTU)
    heard = listener.chars(placed(request, 0, timing))
    heard += listener.chars(placed(rtu(1, 3, 4, bytes(4))[:4], TICKS_PER_SECOND // 50, timing))
    heard += listener.chars(placed(rtu(1, 3, 4, bytes(4))[4:], TICKS_PER_SECOND // 20, timing))
    heard += listener.chars(placed(request, TICKS_PER_SECOND // 5, timing)) + listener.close()
    assert [(each.verdict.value, each.reason) for each in heard] == [
        ("sound", ""),
        ("damaged", "silence inside"),
        ("sound", ""),
    ]


def test_outcomes_of_exchanges() -> None:
    timing = LineTiming(9600, CharFormat(8, "N", 1))
    read, other = rtu(1, 3, 0, 0, 0, 2), rtu(2, 4, 0, 9, 0, 1)
    right = rtu(1, 3, 4, 0, 1, 0, 2)
    steps = [
        (0.0, read), (0.02, right),  # ok
        (1.0, read), (1.02, rtu(1, 0x83, 2)),  # exception
        (2.0, read), (2.02, rtu(1, 3, 2, 0, 1)),  # too short: wrong
        (3.0, read), (3.02, rtu(2, 3, 4, 0, 1, 0, 2)),  # of another station: wrong…
        (3.06, right),  # …and then the right one
        (4.0, read), (4.1, read), (4.12, right), (4.14, right),  # late: a response to the repeat, and one too many
        (5.0, rtu(0, 6, 0, 1, 0, 1)),  # to all
        (5.5, rtu(0, 3, 0, 1, 0, 1)),  # a read to which no station may respond
        (6.0, other), (6.02, rtu(2, 4, 2, 0, 5)),
        (7.0, rtu(250, 3, 0, 0, 0, 1)), (7.02, rtu(250, 3, 2, 0, 5)),
        (8.0, read),  # open at the end
    ]  # fmt: skip
    decoder = listened(steps, timing).decoder
    assert dict(decoder.outcomes) == {
        "ok": 5, "exception": 1, "wrong_answer": 1, "no_answer": 2, "broadcast": 1, "undecided": 1,
    }  # fmt: skip
    assert (decoder.unasked, decoder.wrong_seen, decoder.reserved) == (1, 1, {250})
    assert decoder.frames == len(steps)


def test_a_response_that_might_be_a_request_begins_no_exchange_at_the_begin_of_a_recording() -> None:
    timing = LineTiming(9600, CharFormat(8, "N", 1))
    ambiguous = rtu(1, 1, 3, 0, 0, 16)  # 24 coils, or 16 coils from 0x0300
    steps = [(0.05, ambiguous)]
    for number in range(1, 6):
        steps += [(number * 0.1, rtu(1, 1, 0, 0, 0, 24)), (number * 0.1 + 0.02, rtu(1, 1, 3, 1, 2, 3))]
    decoder = listened(steps, timing).decoder
    assert (decoder.outcomes, decoder.unasked) == ({"ok": 5}, 1)
    replied = listened([(0.0, ambiguous), (0.03, rtu(1, 1, 2, 5, 6)), *steps[1:]], timing).decoder
    assert (replied.outcomes, replied.unasked) == ({"ok": 6}, 0)


@pytest.mark.parametrize("echo_after", [0.0001, None])
def test_echoes_are_told_from_responses(echo_after: float | None) -> None:
    timing = LineTiming(9600, CharFormat(8, "N", 1))
    pairs = [(rtu(1, 3, 0, 0, 0, 2), rtu(1, 3, 4, bytes(4))), (rtu(1, 6, 0, 1, 0, 7), rtu(1, 6, 0, 1, 0, 7))]
    frames: list[tuple[float, bytes]] = []
    for number in range(40):
        request, response = pairs[number % 2]
        at = number * 0.4
        frames.append((at, request))
        if echo_after is not None:
            frames.append((at + SERIAL.lasts(len(request)) + echo_after, request))
        if number % 10 != 7:
            frames.append((at + 0.05, response))
    frames.append((40 * 0.4, pairs[0][0]))
    decoder = listened(frames, timing).decoder
    assert decoder.echoes == (40 if echo_after is not None else 0)
    assert decoder.outcomes == {"ok": 36, "no_answer": 4, "undecided": 1}
    assert decoder.frames == 77


@pytest.mark.parametrize(
    ("waits", "expected"),
    [
        ([0.02, 0.5] * 10, {"ok": 10, "undecided": 1}),  # requests and responses
        ([0.05] * 19, {"unclear": 20}),  # it cannot be known
        ([0.02, 0.5] * 5 + [0.3] + [0.02, 0.5] * 5, {"ok": 10, "no_answer": 1, "undecided": 1}),
        ([0.1, 0.1, 0.7] * 6, {"unclear": 19}),  # threes are no pairs
        ([0.02], {"ok": 1}),
        ([0.02, 0.03, 0.025, 0.02, 0.03, 0.025, 0.02], {"unclear": 8}),
    ],
)
def test_writes_that_are_all_alike(waits: list[float], expected: dict[str, int]) -> None:
    timing = LineTiming(9600, CharFormat(8, "N", 1))
    write, now, frames = rtu(1, 6, 0, 5, 0, 9), 0.1, []
    for wait in (0.0, *waits):
        now += wait
        frames.append((now, write))
        now += len(write) * 10 / 9600
    decoder = listened(frames, timing).decoder
    assert dict(decoder.outcomes) == expected
    assert decoder.frames == len(frames)


def test_damage_at_the_recorder_only() -> None:
    timing = LineTiming(9600, CharFormat(8, "N", 1))
    read, right = rtu(1, 3, 0, 0, 0, 2), rtu(1, 3, 4, bytes(4))
    bad_read, bad_right = read[:-1] + b"\x00", right[:-1] + b"\x00"
    frames, now = [], 0.1
    for number in range(30):
        frames.append((now, bad_read if number == 5 else read))
        if number % 7 == 3:  # the master repeats
            frames.append((now + 0.03, bad_right))
            now += 0.1
            frames.append((now, read))
        frames.append((now + 0.03, bad_right if number == 20 else right))
        now += 0.3
        other = rtu(2, 4, 0, number, 0, 1)
        frames += [(now, other), (now + 0.03, rtu(2, 4, 2, 0, number))]
        now += 0.3
    decoder = listened(frames, timing).decoder
    assert decoder.recorder_damage == 2  # one request with a response, one response that was not repeated


@pytest.mark.parametrize("tolerance", [0, TICKS_PER_SECOND // 50])
@pytest.mark.parametrize("reply", ["damaged", "wrong"])
def test_a_master_that_repeats_at_once_is_no_echo(reply: str, tolerance: int) -> None:
    """Where times are those of the system, its repeat is as close to the request as an echo may be."""
    timing = LineTiming(38400, CharFormat(8, "N", 1))
    read, right = rtu(1, 3, 0, 0, 0, 2), rtu(1, 3, 4, bytes(4))
    bad = right[:-1] + b"\x00" if reply == "damaged" else rtu(1, 3, 2, 0, 7)
    frames = []
    for number in range(40):
        at = 0.1 + 0.1 * number
        frames += [(at, read), (at + 0.005, bad if number % 4 == 3 else right)]
        if number % 4 == 3:
            frames += [(at + 0.012, read), (at + 0.017, right)]
    decoder = listened(frames, timing, exact=not tolerance, tolerance=tolerance).decoder
    outcome = "damaged" if reply == "damaged" else "wrong_answer"
    assert (decoder.outcomes, decoder.strays) == ({"ok": 40, outcome: 10}, 0)


def test_modbus_ascii_with_odd_ends(tmp_path: Path) -> None:
    serial = Serial(9600, 7, "E", 1)
    sent, _ = modbus(serial, 30, 3, frame=ascii_frame)
    changed = [
        each._replace(
            chars=(
                each.chars.rstrip(b"\r\n") + b"\r",
                each.chars.rstrip(b"\r\n") + b"\n",
                each.chars.lower(),
            )[index % 3]
        )
        for index, each in enumerate(sent)
    ]
    found = sniffed(sigrok(tmp_path / "line.sr", RATE, {"D0": wave(changed, serial, RATE)}))
    assert (found["protocol"], found["frames"], ok(found)) == ("modbus-ascii", 60, 30)
    assert "ascii_frames" in {each["code"] for each in found["warnings"]}


# -- the same line, recorded in any way -------------------------------------------------------------------
