"""Poll lists without figures: why there are none, in words; and their JSON form."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import pytest

from bussim.devices.free.scripted import Message
from bussim.line.characters import CharFormat, LineTiming
from bussim.plc.memory import parse_device
from bussim.plc.ports.spec import FreeSpec, PollSpec
from bussim.plc.program.program import Program
from tests.exact.polls.poll_buses import (
    ask,
    figures,
    form,
    four_polls,
    only,
    random_bus,
    reasons,
    station,
    with_polls,
)
from tests.sim.build import MS, SECOND, run
from tests.sim.serial import FREE, MASTER, SLAVE, device, hmi, plc, poll, port, scripted, serial_bus


def test_two_masters() -> None:
    scenario = serial_bus(
        [station(), hmi("panel", poll())], [plc("press", port("COM3", MASTER), polls=[ask()])]
    )
    assert "panel also asks on bus: requests and responses collide" in reasons(scenario)
    assert "press.COM3 also asks" in reasons(scenario, "panel")
    # One without polls is silent.
    quiet = replace(scenario, plcs=(replace(scenario.plcs[0], polls=()),))
    assert list(figures(quiet)) == ["panel"]
    assert only(quiet).model.valid


def test_a_protocol_of_its_own() -> None:
    spec = FreeSpec("say", "COM3", parse_device("D200"), 5, every=SECOND)
    scenario = serial_bus([], [plc("press", port("COM3", FREE), polls=[spec])])
    assert "free protocol" in reasons(scenario)
    reader = scripted("reader", Message(b"123\r", at=0, every=SECOND))
    assert "reader sends on bus in a protocol of its own" in reasons(
        with_polls(ask(), devices=(station(), reader))
    )


def test_a_program() -> None:
    scenario = with_polls(ask())
    program = Program.parse("LD M8000\nOUT Y0\nEND\n", "a.il")
    press = replace(scenario.plcs[0], program=program)
    assert "its program makes scans longer" in reasons(replace(scenario, plcs=(press,)))
    rs2 = Program.parse("LD M8000\nRS2 D100 H0 D101 D200 K3\nEND\n", "b.il")
    press = replace(scenario.plcs[0], program=rs2, polls=())
    scenario = replace(scenario, plcs=(press,), devices=(*scenario.devices, hmi("panel", poll())))
    assert "its program drives RS2" in reasons(scenario)
    assert "press.COM3 also asks" in reasons(scenario, "panel")
    slave = plc("other", port("COM4", SLAVE, station=2), program=program)
    scenario = with_polls(ask(number=2))
    assert "its program makes its scans longer" in reasons(replace(scenario, plcs=(*scenario.plcs, slave)))


@pytest.mark.parametrize(
    ("changes", "why"),
    [
        ({"number": 9}, "no slave on bus responds as station 9"),
        ({"count": 126}, "it cannot be sent (data)"),
        ({"function": 7}, "it cannot be sent (unsupported function)"),
        (
            {"address": 199},
            "feeder refuses it every time: it does not have all of these addresses (exception 02)",
        ),
        ({"to": "D8255"}, "2 items do not lie in memory from D8255 on"),
        ({"function": 16, "to": None, "values": (1,)}, "it has 1 value for 2 addresses"),
        ({"function": 1, "count": 8, "to": "M0"}, "it does not have all of these addresses"),
    ],
)
def test_polls_that_fail_every_time(changes: dict[str, object], why: str) -> None:
    scenario = with_polls(ask(**changes))  # type: ignore[arg-type]
    assert why in reasons(scenario)
    done = run(scenario)
    assert "ok" not in {record.outcome for record in done.record.transactions}


def test_slaves_that_cannot_serve_it() -> None:
    stepper = device("drive", "stepper")
    assert "it does not have that function (exception 01)" in reasons(
        with_polls(ask(function=4), devices=(stepper,))
    )
    assert "does not allow writing there" in reasons(
        with_polls(ask(function=6, address=0x16, count=1, to=None, values=(1,)), devices=(stepper,))
    )
    assert "refuses these values (exception 03)" in reasons(
        with_polls(ask(function=6, address=0x10, count=1, to=None, values=(999,)), devices=(stepper,))
    )
    # What becomes of a command depends on the motor: that is no reason.
    go = ask(function=5, address=7, count=1, to=None, values=(1,))
    assert only(with_polls(go, devices=(stepper,))).model.valid
    twice = (station(), station("twin"))
    assert "feeder, twin both respond as station 1" in reasons(with_polls(ask(), devices=twice))
    fast = station(timing=LineTiming(19200, CharFormat(8, "N", 1)))
    assert "no slave on bus responds as station 1, feeder has another format or mode" in reasons(
        with_polls(ask(), devices=(fast,))
    )


def test_a_timeout_too_short() -> None:
    stepper = device("drive", "stepper")
    assert (
        "the response of drive takes 44.375 ms from the request's end on: it never comes in time"
        in reasons(with_polls(ask(), devices=(stepper,), timeout=4))
    )
    some = station(delay=30 * MS, jitter=20 * MS)
    assert "it may come too late" in reasons(with_polls(ask(), devices=(some,), timeout=5))
    assert only(with_polls(ask(), devices=(some,), timeout=6)).model.valid


def test_a_slave_that_needs_a_longer_silence() -> None:
    # 4.5 characters for the V80 (at every rate), 3.5 for the master: it misses what follows at once.
    devices = (station(), device("pump", "v80", 2))
    polls = (poll("a"), poll("b", 2))
    hasty = serial_bus([*devices, hmi("panel", *polls, interval=0)], seconds=3)
    assert "pump needs 4.688 ms of silence before a request, and gets 3.646 ms" in reasons(hasty, "panel")
    assert "no response in time" in {r.outcome for r in run(hasty).record.transactions}
    patient = serial_bus([*devices, hmi("panel", *polls, interval=2 * MS)], seconds=3)
    assert only(patient).model.valid
    assert {r.outcome for r in run(patient).record.transactions} == {"ok"}


def test_bad_words_of_a_port() -> None:
    scenario = with_polls(ask(), form=form(LineTiming(9600, CharFormat(7, "E", 1))))
    assert "7 data bits, RTU needs 8" in reasons(scenario)


def test_periods_and_commands_in_words() -> None:
    def remarks(*polls: PollSpec) -> tuple[str, ...]:
        return only(with_polls(*polls)).remarks

    assert remarks(ask(every=SECOND)) == ()
    assert remarks(ask()) == ()
    assert "turns of go come on top of the cycle" in remarks(ask(), ask("go", times=1, to=None))[0]
    assert "goes round without a pause" in remarks(ask(every=30 * MS), ask("b", every=30 * MS))[0]
    assert "then a turn is left out" in remarks(ask(every=40 * MS), ask("b", every=900 * MS))[0]
    assert "b has no period and so fill" in remarks(ask(every=SECOND), ask("b"))[0]


def documents() -> Iterator[dict[str, object]]:
    for seed in range(6):
        for found in figures(random_bus(seed)).values():
            yield found.to_json()


def test_the_json_form() -> None:
    import json

    for form_ in documents():
        assert json.loads(json.dumps(form_)) == form_
    found = only(four_polls())
    form_ = found.to_json()
    assert form_["dead"] == {
        "feeder": {
            "devices": ["feeder"],
            "polls": ["a", "b", "c", "d"],
            "attempts": 16,
            "lost_ms": 1600.0,
            "cycle_ms": {
                "min": found.dead[0].cycle.least / MS,
                "max": found.dead[0].cycle.most / MS,
                "mean_at_most": found.dead[0].cycle.most / MS,
            },
        }
    }
    assert form_["timeout_ms"] == 100
    assert form_["cycle_ms"]["mean"] == found.mean / MS  # type: ignore[index,operator]
    first = form_["polls"]["a"]  # type: ignore[index]
    assert first["response_ms"] == {"min": (9 + 3.5) * 10 / 9.6, "max": (9 + 3.5) * 10 / 9.6}
