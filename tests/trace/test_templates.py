"""Lines of records that differ in their times are made of one text: each is what its record says."""

from __future__ import annotations

import io
import json

from bussim.line.protocols import BusProtocol
from bussim.trace.codec import to_line
from bussim.trace.file import TraceWriter
from bussim.trace.records import AttemptRecord, FrameRecord, Record, ScanRecord, TraceBus, TraceHeader

MARK = 10**18  # what stands for the first time while a text is made
ORDINARY = FrameRecord("link", 10, 20, "p0", "data", 0, 3, b"\2A%", (), {}, False, False)


def test_lines_are_those_of_single_records() -> None:
    records: list[Record] = []
    for tick in (0, 5, MARK + 1, 7):
        records += [
            ORDINARY._replace(start=tick, end=tick + 9),
            ORDINARY._replace(start=tick, end=tick + 9, sender=f"100 % of %d {MARK}"),
            ORDINARY._replace(start=tick, end=tick, damaged_at={"p1": (tick,)}),
            ORDINARY._replace(start=tick, end=tick, damaged_bits=(tick, 3), released=tick, ppm=2.5),
            ORDINARY._replace(start=tick, end=tick, baud=9600, format="8N1", pauses=((1, tick),)),
            AttemptRecord("link", tick, tick + 4, 1, 1, "ok", 0, tick),
            AttemptRecord("link", tick, tick + 4, 1, 1, "no reply", 1, None),
            ScanRecord("link", tick, tick + 1, tick + 2, 7, 0, 0, f"slow: {MARK + 2} %s"),
        ]
    header = TraceHeader(buses=(TraceBus("link", BusProtocol.NN, 38400, "7E1", ("p0",), {}),))
    file = io.StringIO()
    writer = TraceWriter(file, header)
    for record in records:
        writer.write(record)
    buses = {each.name: each for each in header.buses}
    lines = file.getvalue().split("\n")[1:-1]
    plain = [
        json.dumps(to_line(record, buses), ensure_ascii=False, separators=(",", ":")) for record in records
    ]
    assert lines == plain
