from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pandas as pd
import pytest
from hypothesis import given
from hypothesis import strategies as st

from bussim.errors import UsageError
from bussim.results.collector import Collector
from bussim.results.meters.plain_data import from_plain, to_plain
from bussim.results.meters.ports import PortRecord, response_time
from bussim.results.run_record import RunRecord
from bussim.results.store.in_memory import MemoryRows
from bussim.results.store.load import FolderRows
from bussim.results.store.rows import FileRows
from bussim.trace.records import (
    CycleRecord,
    DeviceValueRecord,
    FreeRecord,
    PollRecord,
    PortTotals,
    RunTotals,
    ScanRecord,
    TransactionRecord,
)
from bussim.units import TICKS_PER_MS, TICKS_PER_SECOND
from tests.results.fakes import Feeder

MS = TICKS_PER_MS
NODE = "press1.COM3"
GOOD = TransactionRecord(
    "feeder", NODE, "p", 1, 1, 3, 22, 2, 10 * MS, 20 * MS, 50 * MS, 58 * MS, 59 * MS, 64 * MS, "ok", None, 0,
    48 * MS, False, 17,
)  # fmt: skip
TIMEOUT = GOOD._replace(
    answer_start=None, answer_end=None, end=120 * MS, taken=128 * MS, outcome="no response in time", error=9,
    served=None,
)  # fmt: skip
EXCEPTION = GOOD._replace(outcome="exception", error=2, exception=2, served=None)
CRC = GOOD._replace(outcome="CRC or LRC", error=3, served=None)
FRAMING = GOOD._replace(outcome="framing", error=8, served=None)
REFUSED = TIMEOUT._replace(sent=None, asked=None, outcome="unsupported function", error=4)
LATE = GOOD._replace(mismatched=True, served=None)
BROADCAST = GOOD._replace(function=16, station=0, answer_start=None, answer_end=None, served=None, poll="all")
NO_COUNTS: dict[str, Any] = {"requests": 0, "answered": 0, "exceptions": {}, "rejected": {}}


def port_totals(**changes: Any) -> PortTotals:
    values = {
        "node": NODE, "plc": "press1", "port": "COM3", "bus": "feeder", "protocol": "modbus-rtu-master",
        "station": None, "errors": {}, **NO_COUNTS, **changes,
    }  # fmt: skip
    return PortTotals(**values)


def port_of(collector: Collector, duration: int = TICKS_PER_SECOND, **changes: Any) -> dict[str, Any]:
    totals = RunTotals(duration, (), (), ports=(port_totals(**changes),))
    found: dict[str, Any] = collector.run(totals, scenario="s", seed=1).summary["ports"][NODE]
    return found


def after(*records: TransactionRecord) -> dict[str, Any]:
    collector = Collector()
    for record in records:
        collector.take(record)
    return port_of(collector)


def test_a_response_takes_from_the_requests_to_the_last_stop_bit_of_the_response() -> None:
    assert response_time(GOOD) == response_time(EXCEPTION) == 38 * MS
    for record in (TIMEOUT, CRC, FRAMING, REFUSED, LATE, BROADCAST):
        assert response_time(record) is None


def test_every_attempt_is_counted_once() -> None:
    all_of_them = [GOOD] * 7 + [TIMEOUT] * 2 + [EXCEPTION, CRC, FRAMING, REFUSED, LATE, BROADCAST]
    port = after(*all_of_them)
    assert port["transactions"] == len(all_of_them) == 15
    assert port["ok"] == 9  # the late response too, which the master cannot distinguish from its own
    assert port["exceptions"] == {"02": 1}
    assert port["timeouts"] == 2
    assert port["crc_errors"] == 1
    assert port["other_errors"] == {"framing": 1, "unsupported function": 1}
    assert port["mismatched_responses"] == 1
    assert after(LATE, FRAMING._replace(mismatched=True))["mismatched_responses"] == 1
    assert port["response_ms"] == {
        "p50": None, "p95": None, "p99": None, "p999": None, "max": 38.0, "min": 38.0, "mean": 38.0,
    }  # fmt: skip
    assert {name: poll["transactions"] for name, poll in port["polls"].items()} == {"p": 14, "all": 1}


@given(
    st.lists(st.sampled_from([GOOD, TIMEOUT, EXCEPTION, CRC, FRAMING, REFUSED, LATE, BROADCAST]), max_size=30)
)
def test_the_counts_add_up(records: list[TransactionRecord]) -> None:
    port = after(*records)
    failed = [
        port["timeouts"],
        port["crc_errors"],
        *port["exceptions"].values(),
        *port["other_errors"].values(),
    ]
    assert port["transactions"] == len(records) == port["ok"] + sum(failed)
    assert port["ok"] == sum(poll["ok"] for poll in port["polls"].values())
    assert port["transactions"] == sum(poll["transactions"] for poll in port["polls"].values())


def test_ages_of_what_is_read() -> None:
    def arrives(served: int, taken: int) -> TransactionRecord:
        return GOOD._replace(served=served * MS, taken=taken * MS)

    # Served at 48 and replaced at 164: 116 old. Served at 150 and replaced at 320: 170 old.
    port = after(arrives(48, 64), arrives(150, 164), TIMEOUT, LATE, arrives(310, 320), CRC)
    age = port["polls"]["p"]["age_ms"]
    assert age["on_arrival"] == {"p50": None, "max": 16.0}
    assert age["before_refresh"] == {"p50": None, "p99": None, "max": 170.0}
    assert age["oldest"] == age["open"] == 1000.0 - 310.0


def test_what_never_arrived_is_as_old_as_the_run_and_a_write_has_no_age() -> None:
    polls = after(TIMEOUT, GOOD._replace(function=16, poll="w"))["polls"]
    assert polls["p"]["age_ms"] == {
        "on_arrival": {"p50": None, "max": None},
        "before_refresh": {"p50": None, "p99": None, "max": None},
        "open": 1000.0,
        "oldest": 1000.0,
    }
    assert polls["w"]["age_ms"] is None


def test_turns_and_cycles() -> None:
    collector = Collector()
    for late, error in ((0, None), (5 * MS, 9), (3 * MS, None)):
        collector.take(PollRecord("feeder", NODE, "p", 10, 20, 1, error, late))
    for number in range(1000):
        collector.take(CycleRecord("feeder", NODE, number, 0, (100 + number % 10) * MS))
    port = port_of(collector)
    poll = port["polls"]["p"]
    assert (poll["turns"], poll["failed_turns"], poll["late_ms"]) == (3, 1, {"max": 5.0})
    assert port["cycle_ms"] == {
        "p50": 104.0, "p95": 109.0, "p99": 109.0, "p999": None, "max": 109.0, "min": 100.0, "mean": 104.5,
        "count": 1000,
    }  # fmt: skip


def test_quantiles_need_ten_samples_beyond_them() -> None:
    assert after(*[GOOD] * 19)["response_ms"]["p50"] is None
    assert after(*[GOOD] * 20)["response_ms"]["p50"] == 38.0
    assert after(*[GOOD] * 999)["response_ms"]["p99"] is None
    assert after(*[GOOD] * 1000)["response_ms"]["p99"] == 38.0


def test_port_errors_are_decimal() -> None:
    assert port_of(Collector(), errors={9: 2, 48: 1, 3: 0})["errors"] == {"09": 2, "48": 1}


def test_keys_by_protocol() -> None:
    masters = {
        "protocol", "bus", "timeout_ms", "transactions", "broadcast_requests", "ok", "answered_with_own_data", "exceptions", "timeouts",
        "crc_errors", "other_errors", "mismatched_responses", "late_responses", "response_ms", "polls", "cycle_ms", "errors",
    }  # fmt: skip
    slaves = {"protocol", "bus", "station", "requests", "answered", "exceptions", "rejected", "errors"}
    free = {"protocol", "bus", "sent", "received", "timeouts", "damaged", "bytes", "messages", "errors"}
    for mode in ("rtu", "ascii"):
        assert port_of(Collector(), protocol=f"modbus-{mode}-master").keys() == masters
        assert port_of(Collector(), protocol=f"modbus-{mode}-slave").keys() == slaves
    assert port_of(Collector(), protocol="free").keys() == free
    for protocol in (None, "hmi"):
        assert port_of(Collector(), protocol=protocol) == {
            "protocol": protocol,
            "bus": "feeder",
            "errors": {},
        }


def test_a_master_that_was_only_listened_to_has_its_port() -> None:
    collector = Collector()
    for record in (GOOD, CRC):
        collector.take(record)
    run = collector.run(RunTotals(TICKS_PER_SECOND, (), ()), scenario="ttyUSB0", seed=0)
    port = run.summary["ports"][NODE]
    assert (port["protocol"], port["bus"], port["transactions"], port["crc_errors"]) == (None, "feeder", 2, 1)
    assert port["timeout_ms"] is None
    assert run.ports[NODE].polls["p"].ok == 1


def test_a_port_that_was_changed_names_all_it_has_been() -> None:
    collector = Collector()
    collector.take(EXCEPTION)
    collector.take(FreeRecord("feeder", NODE, "", "sent", 0, 9, b"12", "", 0))
    port = port_of(collector, protocol="modbus-rtu-slave", requests=4, answered=4, exceptions={2: 1, 3: 2})
    assert port["transactions"] == 1
    assert port["requests"] == 4
    assert port["bytes"] == {"sent": 2, "received": 0}
    assert port["exceptions"] == {"02": 2, "03": 2}


def test_free_protocol_counts() -> None:
    collector = Collector()
    for record in (
        FreeRecord("feeder", NODE, "c", "sent", 0, 9, b"123", "", 0),
        FreeRecord("feeder", NODE, "c", "received", 0, 9, b"1234\r", "end character", 2),
        FreeRecord("feeder", NODE, "c", "received", 0, 9, b"12", "all bytes are there", 0),
        FreeRecord("feeder", NODE, "c", "received", 0, 9, b"9", "timeout", 1),
        FreeRecord("feeder", NODE, "c", "received", None, 9, b"", "timeout", 0),
    ):
        collector.take(record)
    assert port_of(collector, protocol="free") == {
        "protocol": "free", "bus": "feeder", "sent": 1, "received": 2, "timeouts": 2, "damaged": 3,
        "bytes": {"sent": 3, "received": 8}, "errors": {},
        "messages": dict.fromkeys(("sent", "whole", "damaged", "wrong", "lost", "not_ready", "away"), 0),
    }  # fmt: skip


FEEDER = Feeder()
RUN = FEEDER.run()


def test_the_summary_of_a_whole_run() -> None:
    summary = RUN.summary
    assert list(summary["ports"]) == ["press1.COM3", "press1.COM5", "press2.COM3", "press2.COM5"]
    assert list(summary["devices"]) == ["feeder1", "scanner", "panel"]
    assert summary["links"] == {}
    assert summary["buses"]["feeder"] == {
        "baud": 9600, "format": "8N1", "nodes": ["press1.COM3", "feeder1"], "bus_load": 0.25,
        "frames": 2 * summary["ports"]["press1.COM3"]["transactions"], "collisions": 0, "undetected_frames": 1,
    }  # fmt: skip
    master = summary["ports"]["press1.COM3"]
    assert master["timeout_ms"] == 100
    assert master["errors"] == {
        "03": master["crc_errors"], "08": master["other_errors"]["framing"], "09": master["timeouts"],
    }  # fmt: skip
    assert (
        35 < master["response_ms"]["min"] <= master["response_ms"]["p50"] <= master["response_ms"]["p95"] < 36
    )
    assert list(master["polls"]) == ["position", "speed"]
    age = master["polls"]["position"]["age_ms"]
    assert 7 <= age["on_arrival"]["p50"] <= age["on_arrival"]["max"] < 16
    # What is read is replaced once a cycle, and is as old as that and a bit when it is.
    assert master["cycle_ms"]["p50"] < age["before_refresh"]["p50"] < master["cycle_ms"]["p50"] + 16
    assert age["before_refresh"]["max"] > master["cycle_ms"]["max"]
    assert summary["ports"]["press1.COM5"]["exceptions"] == {"03": 1}
    assert summary["ports"]["press2.COM5"] == {"protocol": None, "bus": "hmi", "errors": {"00": 1}}
    assert summary["devices"]["feeder1"]["state"] == {"position": 20000}
    assert summary["devices"]["scanner"]["sent"] == master["cycle_ms"]["count"]
    assert summary["devices"]["panel"]["timeout_ms"] == 500
    assert summary["devices"]["panel"]["transactions"] == 0
    json.dumps(summary, allow_nan=False)


@pytest.mark.slow
def test_memory_does_not_grow_with_the_run() -> None:
    def size(run: RunRecord) -> int:
        return len(json.dumps(to_plain(run.ports["press1.COM3"])))

    assert size(Feeder(duration=600 * TICKS_PER_SECOND).run()) < 2 * size(RUN)


def test_records_survive_json() -> None:
    for port in RUN.ports.values():
        again = from_plain(PortRecord, json.loads(json.dumps(to_plain(port))))
        assert to_plain(again) == to_plain(port)
        assert again.responses.to_json() == port.responses.to_json()
    again_run = RunRecord.from_json(RUN.summary, json.loads(json.dumps(RUN.histograms())))
    assert again_run.histograms() == RUN.histograms()


def written(folder: Path, fmt: str, *, traced: bool = False, rows: bool = True) -> FolderRows:
    folder.mkdir()
    kept = FileRows(folder, rows=rows, traced=traced, fmt=fmt)
    FEEDER.run(rows=kept, traced=traced)
    kept.close()
    return FolderRows(folder)


@pytest.mark.parametrize("fmt", ["csv", "parquet"])
def test_tables_in_files_are_those_in_memory(tmp_path: Path, fmt: str) -> None:
    memory = MemoryRows(rows=True, traced=True)
    FEEDER.run(rows=memory, traced=True)
    stored = written(tmp_path / "run", fmt, traced=True)
    for kind in (TransactionRecord, FreeRecord, DeviceValueRecord, ScanRecord):
        pd.testing.assert_frame_equal(stored.table(kind), memory.table(kind), check_exact=True)
    assert list(stored.open_trace()) == list(memory.open_trace())
    table = memory.table(TransactionRecord)
    master = RUN.summary["ports"]["press1.COM3"]
    assert len(table) == master["transactions"]
    assert (table["outcome"] == "ok").sum() == master["ok"]
    assert table["mismatched"].dtype == bool
    assert table["mismatched"].sum() == master["mismatched_responses"]
    assert (table["error"] == 9).sum() == master["timeouts"]
    assert table["response_ms"].max() == master["response_ms"]["max"]
    assert table["response_ms"].isna().sum() == len(table) - table["response_ms"].count() > 0
    assert set(memory.table(FreeRecord)["bytes"]) == {"41 31 0D", ""}
    assert memory.table(DeviceValueRecord)["value"].tolist() == list(range(master["cycle_ms"]["count"]))


def test_csv_says_what_the_record_said(tmp_path: Path) -> None:
    rows = FileRows(tmp_path, rows=True, traced=False, fmt="csv")
    for record in (GOOD, TIMEOUT, LATE, REFUSED):
        rows.take(record)
    rows.close()
    assert (tmp_path / "modbus.csv").read_bytes().decode().split("\r\n") == [
        (
            "bus,master,poll,attempt,station,function,address,count,sent_s,asked_s,answered_s,end_s,taken_s,"
            "response_ms,outcome,error,exception,mismatched"
        ),
        (
            "feeder,press1.COM3,p,1,1,3,22,2,0.010000000,0.020000000,0.058000000,0.059000000,0.064000000,"
            "38.000000,ok,,0,0"
        ),
        (
            "feeder,press1.COM3,p,1,1,3,22,2,0.010000000,0.020000000,,0.120000000,0.128000000,"
            ",no response in time,9,0,0"
        ),
        (
            "feeder,press1.COM3,p,1,1,3,22,2,0.010000000,0.020000000,0.058000000,0.059000000,0.064000000,"
            ",ok,,0,1"
        ),
        "feeder,press1.COM3,p,1,1,3,22,2,,,,0.120000000,0.128000000,,unsupported function,4,0,0",
        "",
    ]


def test_only_tables_with_rows_are_written(tmp_path: Path) -> None:
    stored = written(tmp_path / "run", "csv")
    assert {path.name for path in (tmp_path / "run").iterdir()} == {
        "link_scans.csv", "modbus.csv", "free.csv", "values.csv",
    }  # fmt: skip
    for name in ("modbus", "free", "values"):
        (tmp_path / "run" / f"{name}.csv").unlink()
    memory = MemoryRows(rows=True, traced=False)
    for kind in (TransactionRecord, FreeRecord, DeviceValueRecord):
        empty = stored.table(kind)
        assert len(empty) == 0
        pd.testing.assert_frame_equal(empty, memory.table(kind))


def test_without_rows_there_are_no_tables(tmp_path: Path) -> None:
    stored = written(tmp_path / "run", "csv", rows=False)
    assert list((tmp_path / "run").iterdir()) == []
    memory = MemoryRows(rows=False, traced=False)
    FEEDER.run(rows=memory)
    for kind in (TransactionRecord, FreeRecord, DeviceValueRecord):
        for kept in (stored, memory):
            with pytest.raises(UsageError, match="rows"):
                kept.table(kind)


def test_rows_are_on_disk_while_the_run_goes_on(tmp_path: Path) -> None:
    rows = FileRows(tmp_path, rows=True, traced=False, fmt="csv")
    Feeder(duration=300 * TICKS_PER_SECOND).run(rows=rows)
    for name in ("modbus.csv", "free.csv", "values.csv"):
        assert (tmp_path / name).stat().st_size > 30_000, name
    rows.close()
