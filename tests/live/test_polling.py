"""Our master against pymodbus servers, over a pair of pseudo-terminals."""

from __future__ import annotations

import sys
import threading
import time
from collections.abc import Iterator
from functools import partial

import pytest

from bussim.commands.poll.plan import Planned
from bussim.commands.poll.session import Tally
from bussim.engines.modbus.adu import Mode
from bussim.engines.modbus.events import ForeignFrame
from bussim.engines.modbus.pdu import (
    Request,
    write_coil,
    write_coils,
    write_register,
    write_registers,
)
from bussim.engines.modbus.polls import Poll, PollList
from bussim.line.characters import CharFormat
from bussim.live.modbus import line_of, master_runner
from bussim.live.polling import PollTurns, Turn
from bussim.live.wire import Wire
from bussim.units import TICKS_PER_SECOND

pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="Windows has no pseudo-terminals")
if sys.platform != "win32":
    from tests.live.peers import PATIENCE, PymodbusServer

both_modes = pytest.mark.parametrize("mode", list(Mode))
REGISTERS = [100 + number for number in range(50)]
slow = partial(pytest.param, marks=pytest.mark.slow)
#: Seconds: a busy machine has time for the nine responses that are in time.
TIMEOUT_S = 0.25
COILS = [number % 3 == 0 for number in range(48)]


def poll_once(
    device: str, mode: Mode, requests: list[Request], *, station: int = 1, rounds: int = 1
) -> list[Turn]:
    wire = Wire(device, line_of(mode, 115200, CharFormat(8, "N", 1)))
    polls = [Poll(station, request) for request in requests]
    turns: list[Turn] = []
    handling = PollTurns(polls, turns.append, rounds)
    runner = master_runner(wire, mode, PollList(polls), timeout=5 * TICKS_PER_SECOND, handling=handling)
    runner.start()
    until = time.monotonic() + 6 * PATIENCE
    try:
        runner.run(lambda: handling.done or time.monotonic() > until)
    finally:
        runner.close()
    return turns


@both_modes
def test_every_function_and_what_was_written_is_read_back(mode: Mode) -> None:
    requests = [
        write_coil(1, on=True),
        write_register(2, 0xBEEF),
        write_coils(8, [1, 1, 0, 1]),
        write_registers(10, [7, 8, 9]),
        Request(1, 0, 12),
        Request(2, 0, 4),
        Request(3, 2, 1),
        Request(3, 10, 3),
        Request(4, 0, 4),
    ]
    with PymodbusServer(mode, REGISTERS, COILS) as server:
        turns = poll_once(server.device, mode, requests)
    assert [turn.last.error for turn in turns] == [None] * len(requests)
    read = [turn.last.response.values for turn in turns[4:] if turn.last.response]
    coils = [int(coil) for coil in COILS]
    coils[1] = 1
    coils[8:12] = [1, 1, 0, 1]
    assert read == [tuple(coils[:12]), (0, 1, 1, 0), (0xBEEF,), (7, 8, 9), (5, 6, 7, 8)]


@both_modes
def test_exceptions_are_reported(mode: Mode) -> None:
    with PymodbusServer(mode, REGISTERS, COILS) as server:
        (turn,) = poll_once(server.device, mode, [Request(3, 1000, 2)])
    assert turn.last.exception == 2
    assert turn.responded
    assert turn.response is not None


@both_modes
def test_200_transactions_without_an_error(mode: Mode) -> None:
    with PymodbusServer(mode, REGISTERS, COILS) as server:
        turns = poll_once(server.device, mode, [Request(3, 0, 50), Request(1, 0, 48)], rounds=100)
    assert {turn.last.error for turn in turns} == {None}
    assert len(turns) >= 200
    assert {turn.last.response.values for turn in turns if turn.last.response} == {
        tuple(REGISTERS),
        tuple(map(int, COILS)),
    }


def test_a_silent_station_is_a_timeout_and_retried() -> None:
    wire = Wire("pty", line_of(Mode.RTU, 115200, CharFormat(8, "N", 1)))
    polls = [Poll(99, Request(3, 0, 1), retries=2)]
    turns: list[Turn] = []
    handling = PollTurns(polls, turns.append, 1)
    runner = master_runner(wire, Mode.RTU, PollList(polls), timeout=TICKS_PER_SECOND // 20, handling=handling)
    runner.start()
    runner.run(lambda: handling.done)
    runner.close()
    (turn,) = turns
    assert [attempt.error for attempt in turn.attempts] == [9, 9, 9]
    assert not turn.responded
    assert turn.response is None


class HeldUp(Wire):
    """A port on a computer that comes back to it 30 ms too late."""

    def read(self, until: int) -> bytes:
        data = super().read(until)
        time.sleep(0.03)
        return data


def test_an_attempt_that_fails_while_this_computer_is_late_is_told_apart() -> None:
    polls = [Poll(99, Request(3, 0, 1), retries=1)]
    turns: list[Turn] = []
    handling = PollTurns(polls, turns.append, 1)
    wire = HeldUp("pty", line_of(Mode.RTU, 115200, CharFormat(8, "N", 1)))
    timeout = TICKS_PER_SECOND // 20
    runner = master_runner(wire, Mode.RTU, PollList(polls), timeout=timeout, handling=handling)
    runner.start()
    runner.run(lambda: handling.done)
    runner.close()
    (turn,) = turns
    assert turn.late == turn.attempts
    tally = Tally(Planned(turn.poll, "station 99", 0, None))
    tally.add(turn)
    found = tally.to_json()
    assert (found["turns"], found["attempts"], found["errors"], found["computer_late"]) == (0, 0, {}, 2)
    assert tally.failed  # nothing is known to be right


@pytest.mark.parametrize("after", [slow(-90), slow(-5), 5, slow(30), 40, 150])
def test_no_value_of_a_late_server_gets_a_wrong_name(after: int) -> None:
    """Responses so many ms behind the timeout: behind its end as the master sees it, however late that is."""
    timed_out = threading.Event()

    def delays() -> Iterator[float]:
        if after > 0:
            assert timed_out.wait(PATIENCE)
        yield after / 1000 + (TIMEOUT_S if after < 0 else 0)

    def ended(turn: Turn) -> None:
        turns.append(turn)
        timed_out.set()

    with PymodbusServer(Mode.RTU, REGISTERS, COILS, delays()) as server:
        wire = Wire(server.device, line_of(Mode.RTU, 115200, CharFormat(8, "N", 1)))
        polls = [Poll(1, Request(3, 0, 1)), Poll(1, Request(3, 1, 1))]
        turns: list[Turn] = []
        late: list[ForeignFrame] = []
        handling = PollTurns(polls, ended, 5, late.append)
        timeout = round(TIMEOUT_S * TICKS_PER_SECOND)
        runner = master_runner(wire, Mode.RTU, PollList(polls), timeout=timeout, handling=handling)
        runner.start()
        runner.run(lambda: handling.done)
        runner.close()
    read = [turn.last.response and turn.last.response.values[0] for turn in turns]
    assert read[1:] == [101, 100, 101, 100, 101, 100, 101, 100, 101]
    if after > 0:
        assert read[0] is None
        (frame,) = late
        assert frame.late is not None
        assert frame.late.request == polls[0].request
