"""Masters of a scenario, a PLC's polls and an HMI, against pymodbus servers."""

from __future__ import annotations

import sys
import time

import pytest

from bussim.engines.modbus.adu import Mode
from bussim.trace.records import Record, TransactionRecord
from tests.serve.serving import HEAD, Serving

pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="Windows has no pseudo-terminals")
if sys.platform != "win32":
    from tests.live.peers import PymodbusServer

REGISTERS = [100 + number for number in range(50)]
COILS = [number % 3 == 0 for number in range(48)]
both_modes = pytest.mark.parametrize("mode", list(Mode))


def scenario(mode: Mode) -> str:
    return f"""{HEAD}
buses: [{{name: line, baud: 115200, format: 8N1}}, {{name: panel, baud: 115200, format: 8N1}}]
plcs:
  - name: plc
    scan: 3 ms
    registers: {{D600: 321}}
    ports:
      COM3: {{bus: line, protocol: modbus-{mode.value}-master, timeout: 2 s}}
    polls:
      - {{name: read, port: COM3, station: 1, function: 3, address: 2, count: 4, to: D400, retries: 2}}
      - {{name: coils, port: COM3, station: 1, function: 1, address: 0, count: 8, to: M100, retries: 2}}
      - {{name: write, port: COM3, station: 1, function: 6, address: 20, count: 1, from: D600, times: 1,
          retries: 2}}
      - {{name: refused, port: COM3, station: 1, function: 3, address: 1000, count: 1, to: D500}}
devices:
  - name: screen
    model: hmi
    bus: panel
    mode: {mode.value}
    timeout: 2 s
    polls:
      - {{name: values, station: 1, function: 3, address: 0, count: 10, retries: 2}}
      - {{name: set, station: 1, function: 0x10, address: 30, values: [5, 6], times: 1, retries: 2}}
"""


class Outcomes:
    """Counts outcomes by poll."""

    def __init__(self) -> None:
        self.outcomes: dict[str, set[str]] = {}
        self.count = 0

    def take(self, record: Record) -> None:
        if not isinstance(record, TransactionRecord):
            return
        self.outcomes.setdefault(record.poll, set()).add(record.outcome)
        self.count += 1


@both_modes
def test_a_plc_polls_a_pymodbus_server(mode: Mode) -> None:
    rows = Outcomes()
    with (
        PymodbusServer(mode, REGISTERS, COILS) as server,
        Serving(scenario(mode), ports=(f"plc.COM3={server.device}",), rows=rows) as serving,
    ):
        serving.wait_for(lambda: rows.count >= 60)
    plc = serving.session.simulation.plcs["plc"]
    assert [plc.read(f"D{400 + n}") for n in range(4)] == REGISTERS[2:6]
    assert [plc.read(f"M{100 + n}") for n in range(8)] == [int(coil) for coil in COILS[:8]]
    assert rows.outcomes["refused"] == {"exception"}
    assert "ok" in rows.outcomes["write"]
    assert "ok" in rows.outcomes["read"]
    (port,) = serving.totals().ports
    assert port.errors.keys() >= {10 + 2} or port.errors  # exceptions raise a port error


@both_modes
def test_an_hmi_polls_a_pymodbus_server_and_writes_once(mode: Mode) -> None:
    rows = Outcomes()
    with (
        PymodbusServer(mode, REGISTERS, COILS) as server,
        Serving(scenario(mode), ports=(f"screen={server.device}",), rows=rows) as serving,
    ):
        serving.wait_for(lambda: rows.count >= 100)
        carried = bytes(server._pair.carried[0])
    assert rows.outcomes["values"] == {"ok"}
    assert rows.outcomes["set"] == {"ok"}
    assert carried.count(b":01100") if mode is Mode.ASCII else carried.count(b"\x01\x10\x00\x1e") == 1


LATE = f"""{HEAD}
buses: [{{name: panel, baud: 115200, format: 8N1}}]
devices:
  - name: screen
    model: hmi
    bus: panel
    timeout: 100 ms
    polls:
      - {{name: a, station: 1, function: 3, address: 0, count: 1}}
      - {{name: b, station: 1, function: 3, address: 1, count: 1}}
plcs: [{{name: plc, scan: 3 ms}}]
"""


@pytest.mark.parametrize(("delay", "warned"), [(0.0, False), (0.14, True)])
def test_a_master_that_may_have_taken_a_late_response_is_warned_of(delay: float, warned: bool) -> None:
    rows = Outcomes()
    with (
        PymodbusServer(Mode.RTU, REGISTERS, COILS, [delay]) as server,
        Serving(LATE, ports=(f"screen={server.device}",), rows=rows) as serving,
    ):
        serving.wait_for(lambda: rows.count >= 4)
    warnings = [text for text in serving.totals().warnings if "cannot tell" in text]
    assert bool(warnings) is warned
    assert all(text.startswith("screen took ") for text in warnings)
    (pace,) = (text for text in serving.totals().warnings if "has no pace" in text)
    assert ("response times" in pace, "scan times" in pace) == (True, False)


def test_requests_that_fail_while_this_computer_is_late_are_not_counted() -> None:
    """Nobody answers; what is due waits for a program that takes 150 ms in between."""
    rows = Outcomes()
    with Serving(LATE, ports=("screen=pty",), rows=rows) as serving:
        serving.wait_for(lambda: rows.count >= 1)
        serving.session._requests.append(lambda: time.sleep(0.15))
        serving.wait_for(lambda: rows.count >= 5)
    uncounted = serving.session.collector.uncounted
    assert uncounted >= 1
    assert serving.session.record().summary["devices"]["screen"]["transactions"] == rows.count - uncounted
    assert any("left out of what is counted" in text for text in serving.totals().warnings)
