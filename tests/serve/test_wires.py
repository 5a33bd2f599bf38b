"""What goes over a wire besides requests and responses: free protocol, pacing, echo, a line that is lost."""

from __future__ import annotations

import os
import select
import socket
import sys
import time

import pytest

from bussim.engines.modbus.adu import Mode, encode_adu
from bussim.live.options import PortOptions
from bussim.results.collector import Collector
from bussim.scenario.loader import load, loads
from bussim.serve.session import Session
from bussim.serve.targets import targets
from bussim.sim.kernel import FAULT
from bussim.sim.runner import simulate
from bussim.trace.records import FrameRecord, TransactionRecord
from bussim.units import TICKS_PER_MS, TICKS_PER_SECOND
from tests.serve.serving import HEAD, LENIENT, PATIENCE, SLAVES, Serving

pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="Windows has no pseudo-terminals")
if sys.platform != "win32":
    from tests.serve.test_bad_input import opened

FREE = f"""{HEAD}
buses: [{{name: belt, baud: 115200, format: 8N1}}]
plcs:
  - name: sorter
    scan: 3 ms
    ports: {{COM3: {{bus: belt, protocol: free, end: "\\r", eight_bit: true, timeout: 2 s}}}}
    polls: [{{name: parcels, port: COM3, to: D300, count: 20}}]
devices:
  - {{name: reader, model: free, bus: belt, says: [{{text: "4006381\\r", at: 10 ms, every: 50 ms}}]}}
"""
REQUEST = encode_adu(Mode.RTU, 2, bytes((3, 0, 0, 0, 10))).chars
RESPONSE = encode_adu(Mode.RTU, 2, bytes((3, 20)) + bytes((0, 7)) * 10).chars


def receive(handle: int, count: int) -> bytes:
    data, until = b"", time.monotonic() + PATIENCE
    while len(data) < count and time.monotonic() < until:
        if select.select((handle,), (), (), 0.5)[0]:
            data += os.read(handle, 4096)
    return data


def test_a_request_with_pauses_is_answered_or_it_is_told_why_not() -> None:
    tolerance = TICKS_PER_SECOND // 10
    served = Serving(SLAVES, "oven", options=PortOptions(tolerance=tolerance))
    with served as serving, opened(serving.device) as handle:
        for pause in (0.001, 0.019):
            for value in REQUEST:
                time.sleep(pause)
                os.write(handle, bytes([value]))
            if not serving.reported:  # else this machine paused for longer
                assert receive(handle, len(RESPONSE)) == RESPONSE
        del serving.reported[:]
        serving.session.bridges[0]._report_from = 0
        os.write(handle, REQUEST[:3])
        time.sleep(0.2)
        os.write(handle, REQUEST[3:])
        serving.wait_for(lambda: serving.reported)
    (text,) = serving.reported
    assert "a frame was given up: behind its first 3 characters nothing came for " in text
    assert "at most 101.75 ms are allowed" in text
    assert "raise --tolerance, which is 100 ms" in text


def test_a_device_with_a_protocol_of_its_own_is_heard() -> None:
    with Serving(FREE, "reader") as serving, opened(serving.device) as handle:
        assert receive(handle, 24).startswith(b"4006381\r4006381\r4006381\r")


def test_a_plc_s_free_port_takes_what_is_sent() -> None:
    with Serving(FREE, "sorter.COM3") as serving, opened(serving.device) as handle:
        plc = serving.session.simulation.plcs["sorter"]
        # What comes before its first END, which drives the instruction, is lost as on the real one.
        serving.wait_for(lambda: os.write(handle, b"AB12\r") == 5 and plc.read("D303") == ord("2"))
        assert [plc.read(f"D{300 + n}") for n in range(4)] == [0x41, 0x42, 0x31, 0x32]


def test_paced_bytes_come_one_by_one_at_the_line_s_rate() -> None:
    """25 characters at 4800 bps last 52 ms; not even a late system makes them come sooner."""
    text = SLAVES.replace("baud: 115200", "baud: 4800")
    options = PortOptions(tolerance=LENIENT.tolerance, paced=True)
    with Serving(text, "oven", options=options) as serving, opened(serving.device) as handle:
        begun = time.monotonic()
        os.write(handle, REQUEST)
        assert receive(handle, len(RESPONSE)) == RESPONSE
        # A lower bound, which a busy machine only makes easier: the request came after it, too.
        assert time.monotonic() - begun >= len(RESPONSE) * 10 / 4800
    assert serving.session.wires[0].counts.sent == len(RESPONSE)


def test_the_echo_of_an_adapter_gets_no_response() -> None:
    """On a loop everything that is sent is heard again: a master would take it for a response."""
    text = f"""{HEAD}
buses: [{{name: line, baud: 115200, format: 8N1}}]
plcs: [{{name: plc, scan: 5 ms}}]
devices:
  - name: screen
    model: hmi
    bus: line
    timeout: 50 ms
    polls: [{{name: p, station: 1, function: 6, address: 0, values: [1]}}]
"""
    for echo, outcome in ((True, "no response in time"), (False, "ok")):
        options = PortOptions(tolerance=LENIENT.tolerance, echo=echo)
        outcomes: set[str] = set()

        class Rows:
            def take(self, record: object, outcomes: set[str] = outcomes) -> None:
                if hasattr(record, "outcome"):
                    outcomes.add(record.outcome)

        with Serving(text, ports=("screen=loop://",), options=options, rows=Rows()) as serving:
            serving.wait_for(lambda outcomes=outcomes: bool(outcomes))
        assert outcomes == {outcome}


def test_a_connection_that_is_lost_comes_back_and_the_rest_goes_on() -> None:
    server = socket.create_server(("127.0.0.1", 0))
    server.settimeout(PATIENCE)
    url = f"socket://127.0.0.1:{server.getsockname()[1]}"
    options = PortOptions(
        tolerance=LENIENT.tolerance, retry_first=10 * TICKS_PER_MS, retry_last=20 * TICKS_PER_MS
    )
    with Serving(SLAVES, ports=(f"oven={url}",), options=options) as serving:
        counts = serving.session.wires[0].counts
        for number in range(3):
            connection, _ = server.accept()
            connection.settimeout(PATIENCE)
            serving.wait_for(lambda number=number: counts.returns >= number)
            connection.sendall(REQUEST)
            response = b""
            while len(response) < len(RESPONSE):
                response += connection.recv(100)
            assert response == RESPONSE
            connection.sendall(REQUEST[:5])  # it hangs up in the middle of a request
            connection.close()
            serving.wait_for(lambda number=number: counts.losses > number)
    server.close()
    assert any("is lost" in text for text in serving.reported)
    assert any("was lost 3 times" in text for text in serving.totals().warnings)


class Kept:
    """Keeps the transactions of a bus."""

    def __init__(self, bus: str) -> None:
        self._bus = bus
        self.transactions: list[TransactionRecord] = []

    def take(self, record: object) -> None:
        if isinstance(record, TransactionRecord) and record.bus == self._bus:
            self.transactions.append(record)


def test_what_is_being_sent_at_the_end_is_recorded() -> None:
    """A response at 4800 bps is on the wire for 52 ms; a pseudo-terminal hands it over at once."""
    taken: list[object] = []

    class Rows:
        def take(self, record: object) -> None:
            taken.append(record)

    text = SLAVES.replace("baud: 115200", "baud: 4800")
    with Serving(text, "oven", rows=Rows(), traced=True) as serving, opened(serving.device) as handle:
        os.write(handle, REQUEST)
        assert receive(handle, len(RESPONSE)) == RESPONSE
    frames = [record.chars for record in taken if isinstance(record, FrameRecord)]
    assert frames == [REQUEST, RESPONSE]


def test_the_simulated_rest_is_what_the_simulation_makes_of_it() -> None:
    """Real time changes nothing on a bus that nothing outside touches: tick by tick the same."""
    scenario = load("nn_with_modbus", ["duration=1 s"])
    alone, beside = Kept("oven"), Kept("oven")
    simulate(scenario, Collector(rows=alone))
    session = Session(scenario, targets(scenario, ["feeder1"], []), rows=beside, duration=TICKS_PER_SECOND)
    with session:
        session.run(lambda: False)
    assert len(beside.transactions) > 20
    assert beside.transactions == alone.transactions


def test_a_computer_that_is_too_slow_is_reported() -> None:
    reported: list[str] = []
    scenario = loads(SLAVES)
    session = Session(
        scenario, targets(scenario, ["v80"], []), report=reported.append, duration=TICKS_PER_SECOND
    )
    session.simulation.kernel.at(TICKS_PER_SECOND // 4, lambda _: time.sleep(0.3), FAULT)
    session.simulation.kernel.at(TICKS_PER_SECOND // 3, lambda _: None, FAULT)
    with session:
        session.run(lambda: False)
    assert any("cannot keep up" in text for text in reported)
    assert session.record().summary["served"]["late_ms"]["max"] >= 200
    assert any("late, at 0." in text for text in session.totals().warnings)
    assert session.now == TICKS_PER_SECOND
