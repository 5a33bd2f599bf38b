"""What a listener makes of a line whose truth is known: the simulation's own records."""

from __future__ import annotations

import json
import random
from itertools import accumulate

import pytest

import bussim
from bussim.devices.v80.map import V80
from bussim.engines.contract import RxChar
from bussim.engines.modbus.adu import Mode, encode_adu
from bussim.engines.modbus.pdu import (
    Request,
    Response,
    encode_exception,
    encode_request,
    encode_response,
    write_register,
)
from bussim.engines.modbus.server import serve
from bussim.line.characters import NN_LINE, CharFormat, LineTiming
from bussim.line.protocols import BusProtocol
from bussim.live.arrival import Arrivals, Timed, placed
from bussim.live.recordings.frames import TraceFile
from bussim.live.recordings.source import LineSetup
from bussim.live.sniff.heard import LineProtocol, Verdict
from bussim.live.sniff.link import LinkDecoder
from bussim.live.sniff.listener import Listener
from bussim.live.sniff.modbus import ModbusDecoder
from bussim.results.collector import Collector
from bussim.trace.file import Trace
from bussim.trace.records import (
    AttemptRecord,
    FrameRecord,
    Record,
    ScanRecord,
    TraceBus,
    TraceHeader,
    TransactionRecord,
)
from bussim.units import TICKS_PER_MS, TICKS_PER_SECOND

LINE = LineTiming(19200, CharFormat(8, "E", 1))
PROTOCOLS = {Mode.RTU: LineProtocol.RTU, Mode.ASCII: LineProtocol.ASCII}


class Noted(Collector):
    """Keeps the records that it gets."""

    def __init__(self) -> None:
        super().__init__(traced=True)
        self.scans: list[ScanRecord] = []
        self.attempts: list[AttemptRecord] = []
        self.transactions: list[TransactionRecord] = []
        self.frames: list[FrameRecord] = []

    def take(self, record: Record) -> None:
        match record:
            case ScanRecord():
                self.scans.append(record)
                super().take(record)
            case AttemptRecord():
                self.attempts.append(record)
            case TransactionRecord():
                self.transactions.append(record)
            case FrameRecord():
                self.frames.append(record)
            case _:
                super().take(record)


@pytest.fixture(scope="module")
def press_line() -> bussim.Result:
    """With an outage of a station, so that there are failed attempts and stations in error."""
    return bussim.run(bussim.load("press_line", ["duration=15 s"]), trace=True)


@pytest.mark.parametrize("dead", [[], [{"at": "0 s", "power_off": "press2"}]])
def test_the_master_s_stop_is_no_link_scan(dead: list[dict[str, str]]) -> None:
    """One STOP in sixteen leaves counters that follow each other, as if nothing had been between them."""
    begins = accumulate(range(400, 1400, 37))  # ms, so that it is in RUN for one scan or for twenty
    stops = [{"at": f"{at} ms", "for": f"{60 + at % 300} ms", "stop": "press1"} for at in begins]
    run = bussim.run(
        bussim.load("press_line", ["duration=26 s", f"faults={json.dumps(dead + stops)}"]), trace=True
    )
    found = heard_scans(run)
    recorded = {(scan.start, scan.duration) for scan in run.open_trace().of(ScanRecord)}
    assert len(recorded) * 0.9 < len(found) <= len(recorded)
    assert {(scan.start, scan.duration) for scan in found} <= recorded


def heard_scans(run: bussim.Result) -> list[ScanRecord]:
    sink, trace = Noted(), run.open_trace()
    listener = Listener("link", NN_LINE, sink, LineProtocol.NN)
    for chunk in TraceFile(trace, trace.bus("link")).chunks(LineSetup(NN_LINE)):
        listener.chars(chunk.chars)
    listener.close()
    return sink.scans


def test_a_link_is_watched_as_the_master_reports_it(press_line: bussim.Result) -> None:
    sink = Noted()
    names = {0: "press1", 1: "press2", 2: "press3"}
    listener = Listener("link", NN_LINE, sink, LineProtocol.NN, names=names)
    trace = press_line.open_trace()
    for chunk in TraceFile(trace, trace.bus("link")).chunks(LineSetup(NN_LINE)):
        listener.chars(chunk.chars)
    listener.close()
    recorded = list(press_line.open_trace().of(ScanRecord))
    assert [scan[:7] for scan in sink.scans] == [scan[:7] for scan in recorded]
    theirs = [a for a in press_line.open_trace().of(AttemptRecord) if not a.code]
    ours = [a for a in sink.attempts if not a.code]
    assert ours == theirs[: len(ours)]
    assert len(theirs) - len(ours) <= 1
    totals = listener.totals(15 * TICKS_PER_SECOND).links[0]
    assert press_line.totals is not None
    truth = press_line.totals.links[0]
    for same in (
        "plc_names",
        "slaves",
        "mode",
        "retries",
        "attempts",
        "timeout",
        "busy",
        "frames",
        "healthy_at",
    ):
        assert getattr(totals, same) == getattr(truth, same)
    assert totals.station_errors == truth.station_errors


@pytest.mark.parametrize("chunk", [1, 7, 100, 4000])
def test_chunks_do_not_change_which_frames_are_heard(press_line: bussim.Result, chunk: int) -> None:
    """As an adapter would hand them over: some characters at once, with its tolerance."""
    frames = [
        record
        for record in press_line.open_trace().of(FrameRecord)
        if record.end < 3 * TICKS_PER_SECOND and not record.damaged_bits
    ]
    raw = b"".join(record.chars for record in frames)
    sink = Noted()
    listener = Listener("link", NN_LINE, sink, LineProtocol.NN, exact=False, tolerance=20 * TICKS_PER_MS)
    arrivals, heard, now = Arrivals(NN_LINE), [], 0
    for at in range(0, len(raw), chunk):
        piece = raw[at : at + chunk]
        now += NN_LINE.characters(len(piece))
        heard += listener.chars(arrivals.chunk(piece, now))
    heard += listener.close()
    assert [one.chars for one in heard] == [record.chars for record in frames]
    assert isinstance(listener.decoder, LinkDecoder)


def exchanges(mode: Mode, seed: int, count: int = 60) -> tuple[list[tuple[bytes, bool]], list[str]]:
    """Frames of random transactions, in order, with whether each is a request; and their outcomes."""
    rng, device = random.Random(seed), V80()
    frames: list[tuple[bytes, bool]] = []
    outcomes: list[str] = []
    requests = [
        lambda: Request(rng.choice([1, 2]), rng.randrange(9000), rng.randint(1, 200)),
        lambda: Request(rng.choice([3, 4]), rng.randrange(9000), rng.randint(1, 125)),
        lambda: write_register(rng.randrange(9000), rng.randrange(0x10000)),
        lambda: Request(3, 9999, 2),  # refused
    ]
    for _ in range(count):
        request = rng.choice(requests)()
        frames.append((encode_adu(mode, 5, encode_request(request)).chars, True))
        if rng.random() < 0.15:
            outcomes.append("no_answer")
            continue
        response = serve(device, request, 0)
        if isinstance(response, Response):
            outcomes.append("ok")
            pdu = encode_response(response)
        else:
            outcomes.append("exception")
            pdu = encode_exception(*response)
        frames.append((encode_adu(mode, 5, pdu).chars, False))
    if outcomes[-1] == "no_answer":
        outcomes[-1] = "undecided"
    return frames, outcomes


@pytest.mark.parametrize("mode", list(Mode))
@pytest.mark.parametrize("seed", range(5))
@pytest.mark.parametrize("tolerance", [0, 20 * TICKS_PER_MS])
def test_modbus_requests_are_paired_with_their_responses(mode: Mode, seed: int, tolerance: int) -> None:
    frames, outcomes = exchanges(mode, seed)
    sink = Noted()
    listener = Listener("bus", LINE, sink, PROTOCOLS[mode], exact=not tolerance, tolerance=tolerance)
    now, delays = 0, []
    for chars, is_request in frames:
        # The master waits for a second, a slave for three milliseconds.
        now += TICKS_PER_SECOND * 2 if is_request else 3 * TICKS_PER_MS
        listener.idle(now)
        listener.chars(placed(chars, now, LINE))
        now += LINE.characters(len(chars))
        if not is_request:
            delays.append(3 * TICKS_PER_MS)
    listener.close()
    assert [record.outcome for record in sink.transactions] == outcomes
    waited = [r.answer_start - r.asked for r in sink.transactions if r.answer_start and r.asked]
    assert waited == pytest.approx(delays, abs=1)
    assert [frame.chars for frame in sink.frames] == [chars for chars, _ in frames]
    assert isinstance(listener.decoder, ModbusDecoder)
    assert listener.decoder.damaged == 0
    assert listener.totals(now).buses[0].frames == len(frames)


@pytest.mark.parametrize("mode", list(Mode))
def test_a_line_without_a_pause_is_still_cut_into_its_frames(mode: Mode) -> None:
    frames, _ = exchanges(mode, 99)
    sink = Noted()
    listener = Listener("bus", LINE, sink, PROTOCOLS[mode], exact=False, tolerance=20 * TICKS_PER_MS)
    raw = b"".join(chars for chars, _ in frames)
    heard = listener.chars(placed(raw, 0, LINE)) + listener.close()
    assert [one.chars for one in heard] == [chars for chars, _ in frames]


def test_noise_between_frames_is_damage_and_nothing_else_is() -> None:
    rng = random.Random(4)
    request = encode_adu(Mode.RTU, 1, encode_request(Request(3, 0, 2))).chars
    listener = Listener("bus", LINE, Noted(), LineProtocol.RTU)
    now, heard = 0, []
    for _ in range(50):
        for data in (rng.randbytes(rng.randint(1, 6)), request):
            now += 20 * TICKS_PER_MS
            heard += listener.chars(placed(data, now, LINE))
            now += LINE.characters(len(data))
    heard += listener.close()
    assert sum(one.frame is not None for one in heard) == 50
    assert sum(one.frame is None for one in heard) == 50


def test_damaged_characters_damage_an_nn_frame(press_line: bussim.Result) -> None:
    first = next(iter(press_line.open_trace().of(FrameRecord)))
    chars: list[Timed] = placed(first.chars, 0, NN_LINE)
    chars[3] = (RxChar(chars[3][0].value, parity_ok=False), *chars[3][1:])
    listener = Listener("link", NN_LINE, Noted(), LineProtocol.NN)
    (heard,) = listener.chars(chars) + listener.close()
    assert heard.frame is None
    assert heard.chars == first.chars


def heard_in(frames: list[FrameRecord]) -> list[Verdict]:
    """What becomes of the frames of a trace of the N:N link."""
    bus = TraceBus("link", BusProtocol.NN, NN_LINE.baud, str(NN_LINE.format), (), {})
    trace = Trace(TraceHeader(buses=(bus,), seed=1, duration=10 * TICKS_PER_SECOND), lambda _: iter(frames))
    listener = Listener("link", NN_LINE, Noted(), LineProtocol.NN)
    found = [
        h for chunk in TraceFile(trace, bus).chunks(LineSetup(NN_LINE)) for h in listener.chars(chunk.chars)
    ]
    return [each.verdict for each in found + listener.close(10 * TICKS_PER_SECOND)]


def test_frames_of_a_trace_are_as_damaged_as_the_level_on_the_wire_makes_them(
    press_line: bussim.Result,
) -> None:
    good = next(iter(press_line.open_trace().of(FrameRecord)))
    half = (good.start + good.end) // 2
    later = good._replace(start=half, end=half + good.end - good.start, sender="press2")
    assert heard_in([good]) == [Verdict.SOUND]
    assert heard_in([good._replace(damaged_bits=(5,))]) == [Verdict.DAMAGED]
    assert heard_in([good._replace(chars=good.chars[:-1] + b"Z")]) == [Verdict.DAMAGED]
    assert heard_in([good._replace(cut=True, end=half)]) == [Verdict.DAMAGED]
    assert heard_in([good._replace(collided=True), later._replace(collided=True)]) == [Verdict.DAMAGED]
    # A flag alone damages nothing: a driver that was on for longer, but not over the next frame.
    assert heard_in([good._replace(collided=True)]) == [Verdict.SOUND]
    assert heard_in([good._replace(damaged_at={"press2": (5,)})]) == [Verdict.SOUND]
    assert heard_in([good._replace(protocol="free")]) == []


def test_a_repeated_write_is_a_retry_and_its_quick_echo_a_response() -> None:
    write = encode_adu(Mode.RTU, 1, encode_request(write_register(1, 2))).chars
    sink = Noted()
    listener = Listener("bus", LINE, sink, LineProtocol.RTU)
    now = 0
    for wait in (0, 4, 500, 5, 500, 900, 4):  # echo; echo; request; repeated; echo
        now += wait * TICKS_PER_MS
        listener.chars(placed(write, now, LINE))
        now += LINE.characters(len(write))
    listener.close()
    assert [(r.outcome, r.attempt) for r in sink.transactions] == [
        ("ok", 1),
        ("ok", 1),
        ("no_answer", 1),
        ("ok", 2),
    ]


def test_a_broadcast_needs_no_response() -> None:
    sink = Noted()
    listener = Listener("bus", LINE, sink, LineProtocol.RTU)
    listener.chars(placed(encode_adu(Mode.RTU, 0, encode_request(write_register(1, 2))).chars, 0, LINE))
    listener.close()
    (record,) = sink.transactions
    assert (record.outcome, record.station, record.answer_end) == ("broadcast", 0, None)
