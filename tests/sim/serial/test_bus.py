"""A bus beside the link: masters, slaves, silences, collisions, and the truth about responses."""

from __future__ import annotations

from collections import Counter
from fractions import Fraction
from math import sqrt

import pytest

from bussim.devices.free.scripted import Message
from bussim.devices.lx.model import LxSettings
from bussim.devices.map.map import Entry
from bussim.devices.map.model import MapSettings
from bussim.devices.map.values import Sweep
from bussim.devices.registry import form_of
from bussim.devices.v80.model import V80Settings
from bussim.engines.modbus.adu import Mode
from bussim.engines.modbus.pdu import FUNCTIONS
from bussim.engines.modbus.server import Space
from bussim.line.characters import CharFormat, LineTiming
from bussim.scenario import fault_kinds, model
from bussim.sim.serial.bus import SerialBus
from bussim.sim.serial.node import SerialNode
from bussim.sim.wire.contract import Listeners
from bussim.trace.records import Outcome
from tests.selection import quick
from tests.sim.build import MS, SECOND, Done, fault, run
from tests.sim.serial import PLAIN, device, hmi, poll, scripted, serial_bus

CHAR = PLAIN.characters(1)
#: 3.5 characters at 9600 8N1, and the 4.5 of a V80.
SILENCE = round(PLAIN.character * Fraction(7, 2))
LONG_SILENCE = round(PLAIN.character * Fraction(9, 2))
#: A read of registers, and the response with one of them.
REQUEST, RESPONSE = 8 * CHAR, 7 * CHAR
INTERVAL = 5 * MS


def outcomes(done: Done) -> Counter[str]:
    return Counter(record.outcome for record in done.record.transactions)


# -- time ------------------------------------------------------------------------------------------


def test_a_plain_transaction_tick_for_tick() -> None:
    done = run(serial_bus([hmi("panel", poll()), device("drive")], seconds=1))
    first, second = done.record.transactions[:2]
    assert (first.sent, first.asked) == (0, REQUEST)
    # The slave knows of the request's end after the silence, and responds without a delay of its own.
    assert first.answer_start == REQUEST + LONG_SILENCE
    assert first.answer_end == REQUEST + LONG_SILENCE + RESPONSE
    assert first.end == first.taken == first.answer_end + SILENCE
    assert second.sent == first.end + INTERVAL
    assert first.served == REQUEST + LONG_SILENCE
    assert set(outcomes(done)) == {"ok"}


@pytest.mark.parametrize("kind", ["v80", "stepper", "map"])
def test_a_device_responds_after_its_own_silence_and_delay(kind: str) -> None:
    given: dict[str, object] = {}
    if kind == "map":
        given["settings"] = MapSettings((Entry(Space.HOLDING, 0, count=9),), FUNCTIONS)
    done = run(serial_bus([hmi("panel", poll()), device("one", kind, **given)], seconds=2))
    port = form_of({"model": kind}).port
    wait = max(round(PLAIN.character * port.gaps.end), port.delay)
    assert {r.answer_start - r.asked for r in done.record.transactions if r.answer_start} == {wait}  # type: ignore[operator]


def test_the_stepper_never_responds_before_35_ms() -> None:
    many = [poll(f"p{n}", 1, 3, n, 1) for n in range(8)]
    done = run(serial_bus([hmi("panel", *many), device("feeder", "stepper", jitter=3 * MS)], seconds=20))
    waits = [r.answer_start - r.asked for r in done.record.transactions if r.answer_start and r.asked]
    assert len(waits) > 200
    assert 35 * MS <= min(waits) < max(waits) <= 38 * MS


def test_a_plc_as_slave_responds_at_its_end() -> None:
    settings = LxSettings(model.Scan(7 * MS), {"D0": 42})
    done = run(serial_bus([hmi("panel", poll()), device("plc", "lx", settings=settings)], seconds=3))
    waits = [r.answer_start - r.asked for r in done.record.transactions if r.answer_start and r.asked]
    assert all(SILENCE <= wait < SILENCE + 7 * MS for wait in waits)
    # ENDs are 7 ms apart, whatever asks when.
    starts = [r.answer_start for r in done.record.transactions if r.answer_start]
    assert len({start % (7 * MS) for start in starts}) == 1


def test_bus_load_is_the_time_that_frames_take() -> None:
    done = run(serial_bus([hmi("panel", poll()), device("drive")], seconds=2))
    frames = done.record.frames
    assert done.totals.buses[0].busy == pytest.approx(sum(f.end - f.start for f in frames), abs=RESPONSE)
    assert done.totals.buses[0].nodes == ("panel", "drive")


def test_frames_say_what_they_are() -> None:
    done = run(serial_bus([hmi("panel", poll(count=2)), device("drive")], seconds=1))
    request, response = done.record.frames[:2]
    assert (request.kind, request.sender, request.chars.hex(" ")) == (
        "request",
        "panel",
        "01 03 00 00 00 02 c4 0b",
    )
    assert (response.kind, response.sender, response.protocol) == ("response", "drive", "modbus-rtu")
    assert (response.baud, response.format, response.ppm, response.station) == (9600, "8N1", 0.0, 1)


def test_ascii() -> None:
    line = LineTiming(9600, CharFormat(7, "E", 1))
    both = {"mode": Mode.ASCII, "timing": line}
    settings = V80Settings({(Space.HOLDING, 0x6B + n): 0x63 for n in range(3)})
    devices = [
        hmi("panel", poll("a", 6, 3, 0x6B, 3), **both),
        device("v80", station=6, settings=settings, **both),
    ]
    done = run(serial_bus(devices, timing=line, seconds=1))
    assert set(outcomes(done)) == {"ok"}
    request, response = done.record.frames[:2]
    assert request.chars == b":0603006B000389\r\n"
    assert response.chars == b":060306006300630063C8\r\n"
    assert response.protocol == "modbus-ascii"


# -- responses to the wrong request -----------------------------------------------------------------


def test_a_late_response_to_an_earlier_request_is_found_out() -> None:
    # The slave needs 60 ms, the master waits 40: every second poll takes the response to the first one.
    polls = poll("a", address=0), poll("b", address=5)
    done = run(serial_bus([hmi("panel", *polls, timeout=40 * MS), device("slow", delay=60 * MS)]))
    by_poll = {name: [r for r in done.record.transactions if r.poll == name] for name in "ab"}
    assert {r.outcome for r in by_poll["a"]} == {"no response in time"}
    assert {(r.outcome, r.mismatched, r.served) for r in by_poll["b"]} == {("ok", True, None)}
    noted = [note for note in done.record.notes if note.kind == "mismatched"]
    assert len(noted) == len(by_poll["b"])


def test_a_right_response_is_never_called_mismatched() -> None:
    polls = [poll(f"p{n}", address=n) for n in range(5)]
    done = run(serial_bus([hmi("panel", *polls), device("drive", jitter=20 * MS)], seconds=20))
    assert not any(r.mismatched for r in done.record.transactions)
    assert all(r.served is not None for r in done.record.transactions)


# -- two masters ------------------------------------------------------------------------------------


def test_two_masters_collide_and_go_on() -> None:
    one = hmi("one", poll("a", every=70 * MS), timeout=50 * MS)
    two = hmi("two", poll("b", every=83 * MS, at=3 * MS), timeout=50 * MS)
    done = run(serial_bus([one, two, device("drive")], seconds=30))
    assert done.totals.buses[0].collisions > 10
    for master in ("one", "two"):
        mine = Counter(r.outcome for r in done.record.transactions if r.master == master)
        assert mine["ok"] > 50
        assert mine["ok"] < sum(mine.values())


# -- noise and faults -------------------------------------------------------------------------------


@pytest.mark.slow
def test_noise_fails_as_many_transactions_as_theory_says() -> None:
    ber = 4e-4
    noise = model.Noise("n", model.Target("bus"), model.BitErrors(ber))
    done = run(
        serial_bus([hmi("panel", poll(count=20)), device("drive")], seconds=150, noise=[noise]), traced=False
    )
    found = outcomes(done)
    total = sum(found.values())
    # Stop bits count: a character framed wrongly damages the frame. Undetected damage is far rarer.
    good = (1 - ber) ** (10 * (8 + 5 + 2 * 20))
    # A damaged last stop bit may go unseen by a frame's reader: the bounds take both readings.
    low = (1 - ber) ** (10 * (8 + 5 + 2 * 20) + 2)
    bound = 4 * sqrt(total * good * (1 - good))
    assert total * low - bound <= found["ok"] <= total * good + bound
    assert found["no response in time"] > 0
    assert found["CRC or LRC"] > 0


def test_lost_and_dropped_replies() -> None:
    loss = model.Noise("l", model.Target("bus", "drive", fault_kinds.Direction.TX), model.ReplyLoss(0.25))
    done = run(serial_bus([hmi("panel", poll()), device("drive")], seconds=60, noise=[loss]), traced=False)
    found = outcomes(done)
    total = sum(found.values())
    assert abs(found["no response in time"] - total / 4) < 4 * sqrt(total * 3 / 16)
    drop = fault(fault_kinds.DropReply("drive", 3), 1)
    done = run(serial_bus([hmi("panel", poll()), device("drive")], seconds=5, faults=[drop]))
    assert outcomes(done)["no response in time"] == 3


@pytest.mark.parametrize(
    "kind",
    [
        fault_kinds.PowerOff("drive"),
        fault_kinds.Jabber("drive"),
        fault_kinds.CableCut("bus", "panel"),
        fault_kinds.WrongFormat("drive", LineTiming(19200, CharFormat(8, "N", 1))),
        fault_kinds.ClockPpm("drive", Fraction(80_000)),
        fault_kinds.Slow("drive", 200 * MS),
    ],
    ids=lambda kind: type(kind).__name__,
)
def test_a_fault_keeps_a_slave_silent_while_it_lasts(kind: fault_kinds.FaultKind) -> None:
    done = run(serial_bus([hmi("panel", poll()), device("drive")], seconds=6, faults=[fault(kind, 2, 2)]))
    good = [r.end / SECOND for r in done.record.transactions if r.outcome == "ok"]
    during = [at for at in good if 2.1 < at < 3.9]
    if isinstance(kind, fault_kinds.Slow):
        # Late responses are taken for the wrong request: all the same to this master.
        assert all(
            r.mismatched for r in done.record.transactions if 2.1 < r.end / SECOND < 3.9 and r.outcome == "ok"
        )
    else:
        assert during == []
    assert min(good) < 0.1
    assert max(good) > 5.5


def test_a_clock_error_within_the_standard_does_no_harm() -> None:
    done = run(
        serial_bus(
            [hmi("panel", poll(count=10)), device("drive")],
            seconds=3,
            faults=[fault(fault_kinds.ClockPpm("drive", Fraction(15_000)))],
        )
    )
    assert set(outcomes(done)) == {"ok"}


# -- broadcast, refusals ----------------------------------------------------------------------------


def test_broadcasts_are_executed_by_all_and_get_no_response() -> None:
    write = poll("w", 0, 6, 7, 1, values=(1234,), every=SECOND)
    read = poll("r", 2, 3, 7)
    done = run(serial_bus([hmi("panel", write, read), device("one", station=1), device("two", station=2)]))
    by = {device.name: device for device in done.totals.devices}
    sent = [r for r in done.record.transactions if r.poll == "w"]
    assert {r.outcome for r in sent} == {"ok"}
    assert by["one"].broadcasts == by["two"].broadcasts == len(sent)
    assert by["one"].answered == 0
    assert sent[0].end - sent[0].asked == 100 * MS  # type: ignore[operator]
    responses = [f for f in done.record.frames if f.sender == "two"]
    assert responses[0].chars[3:5] == (1234).to_bytes(2, "big")


def test_a_device_refuses_what_it_lacks() -> None:
    polls = poll("coils", 1, 1, 0, 1), poll("spare", 1, 3, 60, 1), poll("good", 1, 3, 0, 1)
    done = run(serial_bus([hmi("panel", *polls), device("feeder", "stepper")]))
    codes = {
        name: {r.exception for r in done.record.transactions if r.poll == name}
        for name in ("coils", "spare", "good")
    }
    assert codes == {"coils": {1}, "spare": {2}, "good": {0}}
    assert set(done.totals.devices[1].exceptions) == {1, 2}


def test_a_register_map_of_the_scenario_moves_with_time() -> None:
    entries = (Entry(Space.HOLDING, 0, Sweep(0, 1000, 10 * SECOND)),)
    settings = MapSettings(entries, FUNCTIONS)
    done = run(serial_bus([hmi("panel", poll()), device("ramp", "map", settings=settings)], seconds=8))
    responses = [f for f in done.record.frames if f.kind == "response"]
    served = [r.served for r in done.record.transactions]
    for frame, tick in zip(responses, served, strict=False):
        assert int.from_bytes(frame.chars[3:5], "big") == 1000 * (tick or 0) // (10 * SECOND)


# -- the stepper ------------------------------------------------------------------------------------


def test_a_new_address_is_taken_after_save_and_power_cycle() -> None:
    address = poll("address", 1, 6, 16, 1, values=(9,), at=100 * MS, times=1)
    save = poll("save", 1, 5, 0, 1, values=(1,), at=SECOND, times=1)
    old, new = poll("old", 1, 3, 0, every=200 * MS), poll("new", 9, 3, 0, every=200 * MS)
    cycle = fault(fault_kinds.PowerOff("feeder"), 3, 0.5)
    done = run(
        serial_bus(
            [hmi("panel", address, save, old, new), device("feeder", "stepper")], seconds=8, faults=[cycle]
        )
    )
    last = {
        name: max(
            (r.end for r in done.record.transactions if r.poll == name and r.outcome == "ok"), default=0
        )
        for name in ("old", "new")
    }
    first_new = min(r.end for r in done.record.transactions if r.poll == "new" and r.outcome == "ok")
    assert last["old"] < 3.1 * SECOND
    assert first_new > 3.5 * SECOND
    assert last["new"] > 7.5 * SECOND
    assert done.totals.devices[1].state["station"] == 9


def test_without_saving_the_old_address_comes_back() -> None:
    address = poll("address", 1, 6, 16, 1, values=(9,), at=100 * MS, times=1)
    cycle = fault(fault_kinds.PowerOff("feeder"), 3, 0.5)
    done = run(
        serial_bus(
            [hmi("panel", address, poll("old", 1, 3, 0)), device("feeder", "stepper")],
            seconds=6,
            faults=[cycle],
        )
    )
    assert max(r.end for r in done.record.transactions if r.outcome == "ok") > 5.5 * SECOND
    assert done.totals.devices[1].state["station"] == 1


# -- scripted ----------------------------------------------------------------------------------------


def test_a_scripted_device_sends_by_the_clock_and_replies() -> None:
    asks = scripted("scale", Message(b"?W\r", at=SECOND, every=SECOND, times=3))
    responses = scripted("head", Message(b"12.5\r", reply_to=b"?W\r", delay=2 * MS))
    done = run(serial_bus([asks, responses], seconds=6))
    said = [(r.node, r.direction, r.data, r.start) for r in done.record.said]
    assert [entry[:3] for entry in said] == 3 * [("scale", "sent", b"?W\r"), ("head", "sent", b"12.5\r")]
    for (_, _, request, asked), (_, _, _, replied) in zip(said[::2], said[1::2], strict=True):
        assert replied == asked + len(request) * CHAR + 2 * MS  # type: ignore[operator]
    assert [entry[3] for entry in said[::2]] == [SECOND, 2 * SECOND, 3 * SECOND]


# -- one way or another -------------------------------------------------------------------------------


def _one_by_one(bus: SerialBus, sender: SerialNode) -> Listeners:
    hearers = [
        port
        for port in bus.ports
        if port is not sender and port.engine is not None and not port.driving and bus.connected(port, sender)
    ]
    return (), tuple(hearers)


def _chance(seed: int) -> model.Scenario:
    """Two masters, three slaves, noise and faults: everything at once."""
    one = hmi("one", poll("a", 1, 3, 0, 4, every=70 * MS), poll("b", 2, 3, 5), timeout=(30 + 7 * seed) * MS)
    two = hmi(
        "two",
        poll("c", 3, 6, 1, values=(seed,), every=110 * MS),
        poll("d", 0, 5, 1, values=(1,), every=900 * MS),
    )
    slaves = [
        device("x", station=1, jitter=9 * MS),
        device("y", "stepper", station=2),
        device("z", "lx", station=3),
    ]
    noise = [
        model.Noise("n", model.Target("bus"), model.BitErrors(2e-4)),
        model.Noise("m", model.Target("bus", "x"), model.BitErrors(5e-4)),
        model.Noise("l", model.Target("bus", "y", fault_kinds.Direction.TX), model.ReplyLoss(0.1)),
    ]
    kinds: list[fault_kinds.FaultKind] = [
        fault_kinds.PowerOff("x"),
        fault_kinds.CableCut("bus", "two"),
        fault_kinds.WrongFormat("y", LineTiming(19200, CharFormat(8, "N", 1))),
        fault_kinds.LateRelease("z", 4 * MS),
        fault_kinds.LoseChar("x", fault_kinds.Direction.TX, None, 3),
        fault_kinds.Pause("y", 2 * MS, None),
        fault_kinds.InsertChar("one", fault_kinds.Direction.RX, None, 2, 0x55),
        fault_kinds.ClockPpm("x", Fraction(30_000)),
    ]
    faults = [fault(kind, 0.7 + 0.4 * n, 0.6) for n, kind in enumerate(kinds) if (n + seed) % 3]
    return serial_bus([one, two, *slaves], seconds=5, seed=seed, noise=noise, faults=faults)


@pytest.mark.parametrize("seed", quick(4, range(12)))
def test_whole_frames_are_what_their_characters_are(seed: int, monkeypatch: pytest.MonkeyPatch) -> None:
    scenario = _chance(seed)
    one = run(scenario)
    monkeypatch.setattr(SerialBus, "listeners_of", _one_by_one)
    other = run(scenario)
    # What happens at one tick may be recorded in another order.
    for kind in ("transactions", "frames", "turns"):
        first, second = (sorted(getattr(done.record, kind), key=repr) for done in (one, other))
        assert first == second
    assert one.totals == other.totals


@pytest.mark.parametrize("seed", quick(2, range(6)))
def test_traced_or_not_the_run_is_the_same(seed: int) -> None:
    one, untraced = run(_chance(seed)), run(_chance(seed), traced=False)
    assert (one.record.transactions, one.totals) == (untraced.record.transactions, untraced.totals)


@pytest.mark.slow
def test_random_scenarios_have_everything() -> None:
    runs = [run(_chance(seed)) for seed in range(12)]
    found = sum((outcomes(done) for done in runs), Counter())
    assert {"ok", "no response in time", "CRC or LRC", "framing", "frame length"} <= set(found)
    # Of a request that met the response to another one it is not known what became of its own.
    assert any(outcome is Outcome.UNKNOWN for done in runs for *_, outcome in done.record.exchanges)
    assert sum(done.totals.buses[0].collisions for done in runs) > 50
