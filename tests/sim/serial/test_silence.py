"""A master that goes on before the silence of Modbus RTU is over: frames run together at who received both."""

from __future__ import annotations

import pytest

from bussim.devices.contract import BusDevice
from bussim.exact.polls.from_scenario import poll_lists
from bussim.line.characters import CharFormat, LineTiming
from bussim.scenario import loader, model
from tests.sim.build import MS, Done, run
from tests.sim.serial import device, hmi, poll, serial_bus

PLAIN = LineTiming(9600, CharFormat(8, "N", 1))
FAST = LineTiming(38400, CharFormat(8, "E", 1))


def scenario(silence: float | None, *slaves: BusDevice, timing: LineTiming = PLAIN) -> model.Scenario:
    """A panel that asks each slave 300 times a minute, one right after the other."""
    polls = [poll(slave.name, slave.station or 0, every=200 * MS) for slave in slaves]
    panel = hmi("panel", *polls, timeout=60 * MS, interval=0, timing=timing, silence=silence)
    return serial_bus([panel, *slaves], seconds=2, timing=timing)


def outcome(done: Done, name: str) -> set[str]:
    found = {record.outcome for record in done.record.transactions if record.poll == name}
    assert found
    return found


def rejected(done: Done, name: str) -> set[str]:
    return {reason for each in done.totals.devices if each.name == name for reason in each.rejected}


#: Modbus over serial line, section 2.5.1.1: more than 1.5 characters inside damage a frame, 3.5 end it; above
#: 19200 bps these are 750 µs and 1.75 ms.
@pytest.mark.parametrize(
    ("timing", "inner", "end"),
    [(PLAIN, 112_500, 262_500), (FAST, 54_000, 126_000)],
    ids=["9600", "38400"],
)
def test_a_reply_and_the_next_request_are_one_frame_to_the_other_slave(
    timing: LineTiming, inner: int, end: int
) -> None:
    for silence, reason in ((10, "CRC or LRC wrong"), (inner, "CRC or LRC wrong"), (inner + 1, "silence inside"), (end - 1, "silence inside")):  # fmt: skip
        slaves = [device(name, "stepper", number, timing=timing) for number, name in ((1, "one"), (2, "two"))]
        done = run(scenario(silence, *slaves, timing=timing))
        # The request to the other one follows a reply; after its timeout the line is quiet for the first again.
        assert outcome(done, "one") == {"ok"}
        assert outcome(done, "two") == {"no response in time"}
        assert rejected(done, "two") == {reason}
        assert rejected(done, "one") == set()
        starts = {record.sent: record for record in done.record.transactions if record.poll == "two"}
        replies = [frame for frame in done.record.frames if frame.sender == "one"]
        assert all(reply.end + silence in starts for reply in replies[:-1])
    for silence in (end, None):
        slaves = [device(name, "stepper", number, timing=timing) for number, name in ((1, "one"), (2, "two"))]
        done = run(scenario(silence, *slaves, timing=timing))
        assert outcome(done, "one") == outcome(done, "two") == {"ok"}


def test_a_number_is_one_of_characters() -> None:
    one, two = device("one", "stepper", 1), device("two", "stepper", 2)
    assert outcome(run(scenario(3.4, one, two)), "two") == {"no response in time"}
    assert outcome(run(scenario(3.5, one, two)), "two") == {"ok"}


def test_a_v80_needs_its_own_silence_and_who_replied_itself_none() -> None:
    # 4.5 characters (V80 and PPC Modbus manual): a master of the standard is too early for it.
    other, v80 = device("one", "stepper", 1), device("two", "v80", 2)
    assert outcome(run(scenario(3.5, other, v80)), "two") == {"no response in time"}
    assert outcome(run(scenario(4.5, other, v80)), "two") == {"ok"}
    alone = scenario(1.0, v80)
    again = [poll("two", 2, every=200 * MS), poll("more", 2, address=1, every=200 * MS)]
    panel = hmi("panel", *again, timeout=60 * MS, interval=0, silence=1.0)
    done = run(serial_bus([panel, v80], seconds=2))
    assert outcome(done, "two") == outcome(done, "more") == {"ok"}
    assert outcome(run(alone), "two") == {"ok"}


def test_the_solver_has_the_silence() -> None:
    one, two = device("one", "stepper", 1), device("two", "stepper", 2)
    early = poll_lists(scenario(2.0, one, two))["panel"]
    assert not early.valid
    assert "two needs 3.646 ms of silence before a request, and gets 2.083 ms" in " ".join(early.obstacles)
    late = scenario(8.0, one, two)
    found = poll_lists(late)["panel"]
    assert found.valid
    records = [record for record in run(late).record.transactions if record.sent is not None]
    for each in found.polls:
        times = [record.taken - record.sent for record in records if record.poll == each.name]
        assert len(times) > 8
        assert each.need.least <= min(times) <= max(times) <= each.need.most


TEXT = """\
schema: 1
name: early
duration: 2 s
buses: [{name: line, baud: 9600, format: 8N1}]
plcs: []
devices:
  - {name: panel, model: hmi, bus: line, DEVICE, polls: [
      {station: 1, function: 3, address: 0, every: 200 ms}, {station: 2, function: 3, address: 0, every: 200 ms}]}
  - {name: one, model: stepper, bus: line, station: 1}
  - {name: two, model: stepper, bus: line, station: 2}
"""


@pytest.mark.parametrize(
    ("given", "silence", "interval", "fails"),
    [
        ("silence: 2", 2.0, 0, True),
        ("silence: 1 ms", MS, 0, True),
        ("silence: 1 ms, interval: 1 ms", MS, MS, True),
        ("silence: 1 ms, interval: 3 ms", MS, 3 * MS, False),
        ("silence: 4.5", 4.5, 0, False),
        ("timeout: 100 ms", None, 5 * MS, False),
    ],
)
def test_a_file_says_it_in_characters_or_as_a_time_and_check_warns(
    given: str, silence: float | None, interval: int, fails: bool
) -> None:
    found = loader.loads(TEXT.replace("DEVICE", given))
    settings = found.devices[0].settings
    assert (settings.silence, settings.interval) == (silence, interval)  # type: ignore[union-attr] # an HMI's
    assert loader.from_data(found.source) == found
    done = run(found)
    assert ("ok" in outcome(done, "station 2 03 @0")) is not fails
    assert any("silence" in text for text in found.warnings) is fails


def test_bad_silences_are_named() -> None:
    for given, wrong in (
        ("silence: 0.05", "silence is 0.05, allowed 0.1..1000"),
        ("silence: 2 s s", "silence is '2 s s'"),
        ("silence: 0 ms", "silence is 0 ms, allowed more than 0 up to 10 y"),
        ("silence: [1]", "silence is a list, expected a number 0.1..1000"),
    ):
        with pytest.raises(loader.ScenarioError) as caught:
            loader.loads(TEXT.replace("DEVICE", given))
        assert wrong in str(caught.value)
