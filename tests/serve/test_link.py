"""Two halves of an N:N link on one wire, each served by a session of its own."""

from __future__ import annotations

import json
import sys
from pathlib import Path

import pytest

from bussim.commands.sniff.command import command as sniff
from bussim.engines.nn.frames import LinkSettings, encode_data, encode_parameters, encode_poll
from bussim.live.options import PortOptions
from bussim.results.store.in_memory import MemoryRows
from bussim.results.store.load import load_run
from bussim.scenario.loader import loads
from bussim.serve.session import session_header
from bussim.serve.targets import targets
from bussim.sim.runner import simulate
from bussim.trace.records import FrameRecord, ScanRecord
from bussim.units import TICKS_PER_SECOND, milliseconds
from tests.serve.serving import HEAD, Serving
from tests.sim.build import Recorder

pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="Windows has no pseudo-terminals")

LINK = f"""{HEAD}
buses: [{{name: link, nn: true}}]
plcs:
  - name: press
    scan: 10 ms
    nn: {{bus: link, port: COM4, station: 0, slaves: 2, mode: 1, retries: 3, timeout: 2250 ms}}
    sources: {{D0: {{constant: 4711}}}}
  - name: feeder
    scan: 6 ms
    nn: {{bus: link, port: COM4, station: 1}}
    sources: {{D32: {{constant: 11}}}}
  - name: stacker
    scan: 6 ms
    nn: {{bus: link, port: COM4, station: 2}}
    sources: {{D64: {{constant: 22}}}}
"""
#: The machine may have much else to do: no silence of its making ends a frame.
PATIENT = PortOptions(tolerance=2 * TICKS_PER_SECOND)
SCANS = 20


@pytest.mark.parametrize("paced", [False, True])
def test_a_link_runs_between_its_two_halves(paced: bool, record_property: pytest.RecordProperty) -> None:
    options = PortOptions(tolerance=PATIENT.tolerance, paced=paced)
    scenario = loads(LINK)
    rows = MemoryRows(
        rows=True, traced=True, header=session_header(scenario, targets(scenario, ["press"], []))
    )
    with Serving(LINK, "feeder", "stacker", options=options) as slaves:
        port = f"press={slaves.device}"
        with Serving(LINK, ports=(port,), options=options, rows=rows, traced=True) as master:
            master.wait_for(lambda: len(rows.table(ScanRecord)) >= SCANS)
    totals, others = master.totals(), slaves.totals()
    (link,), (half,) = totals.links, others.links
    assert link.master == "press"
    assert link.plc_names == ("press", "feeder", "stacker")
    assert link.healthy_at is not None
    assert link.station_errors == {1: 0, 2: 0}
    # Blocks arrive: in the memory of every PLC lies what the others have.
    press = master.session.simulation.plcs["press"]
    feeder, stacker = (slaves.session.simulation.plcs[name] for name in ("feeder", "stacker"))
    assert (press.read("D32"), press.read("D64")) == (11, 22)
    assert (feeder.read("D0"), feeder.read("D64")) == (4711, 22)
    assert (stacker.read("D0"), stacker.read("D32")) == (4711, 11)
    assert half.undetected == half.collisions == 0
    # Its master is there, though not here.
    assert "no_master" not in [finding["key"] for finding in slaves.session.record().summary["verdict"]]
    # Of the PLCs on the other side no register is known.
    assert [plc.name for plc in totals.plcs if plc.registers] == ["press"]
    assert [plc.name for plc in others.plcs if plc.registers] == ["feeder", "stacker"]
    hints = master.session.hints()
    assert bool(hints) is not paced
    assert all("--paced" in hint for hint in hints)
    refresh = master.session.record().links["link"].refresh
    assert refresh["feeder", "press"].gaps.count >= SCANS - 5
    assert set(refresh) == {("feeder", "press"), ("stacker", "press")}
    measured = rows.table(ScanRecord)["duration_ms"].median()
    recorder = Recorder()
    simulate(loads(LINK, overrides=["duration=2 s"]), recorder)
    predicted = milliseconds(recorder.scans[10].duration)
    record_property("link scan ms", f"{measured:.3f} measured, {predicted:.3f} simulated, paced: {paced}")
    print(f"link scan: {measured:.3f} ms measured, {predicted:.3f} ms simulated, paced: {paced}")  # noqa: T201
    # The trace has both directions, by their names.
    senders = {(frame.sender, frame.kind) for frame in rows.open_trace().of(FrameRecord)}
    assert {("press", "poll"), ("press", "data"), ("feeder", "data"), ("stacker", "data")} <= senders


def test_sniff_measures_the_link_in_a_session_s_trace(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    from bussim.results.store.folder import RunFolder

    scenario = loads(LINK)
    header = session_header(scenario, targets(scenario, ["press"], []))
    with (
        RunFolder(tmp_path / "out", rows=True, traced=True, fmt="csv", header=header) as folder,
        Serving(LINK, "feeder", "stacker", options=PATIENT) as slaves,
    ):
        with Serving(
            LINK, ports=(f"press={slaves.device}",), options=PATIENT, rows=folder.rows, traced=True
        ) as master:
            engine = master.session.simulation.plcs["press"]
            master.wait_for(lambda: engine.master is not None and engine.master.polls > 60)
        results = folder.finish(master.session.record(), "")
    sniff.main([str(results), "--json"], standalone_mode=False)
    heard = json.loads(capsys.readouterr().out)
    assert heard["exact_times"] is False
    assert heard["protocol"] == "nn"
    # The same link scans as the master itself measured: both from its data frames' first edges.
    own = load_run(results).summary["links"]["link"]
    assert own["scans"] >= 20
    assert heard["link"]["scans"] == pytest.approx(own["scans"], abs=1)
    assert heard["link"]["scan_time_ms"]["max"] == pytest.approx(own["scan_time_ms"]["max"])
    assert heard["link"]["station_errors"] == own["station_errors"]


def test_an_external_station_has_a_position_of_its_own() -> None:
    """A block of a station that no scenario knows is stored, and recorded as an external node's."""
    from tests.serve.test_bad_input import opened, pour

    block = bytes(4) + (777).to_bytes(2, "big") + bytes(6)
    frames = (
        encode_parameters(2, LinkSettings(7, 1, 3, 225)),
        encode_poll(7, 3),
        encode_data(7, 3, block),
        encode_poll(7, 4),
        encode_data(7, 4, block),
    )
    with Serving(LINK, "feeder", options=PATIENT) as half, opened(half.device) as handle:
        for frame in frames:
            pour(half, handle, frame.chars)
        feeder = half.session.simulation.plcs["feeder"]
        half.wait_for(lambda: half.session.simulation.kernel.now > 0)
    (link,) = half.totals().links
    assert feeder.read("D224") == 777
    assert link.plc_names == ("feeder", "press", "stacker", "station 7 outside")
    refresh = half.session.record().links["link"].refresh
    assert refresh["station 7 outside", "feeder"].gaps.count == 1
    assert refresh["press", "feeder"].last is None
