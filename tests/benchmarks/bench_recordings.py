"""How fast recordings are read, in characters a second of this process's time, by kind and protocol.

    python tests/benchmarks/bench_recordings.py [CHARACTERS]

An N:N link and a Modbus RTU line with one damaged response in twenty, each as run folder, pcapng, pcap, text and
waveform, are read by ``sniff``. Nothing is asserted: a time is no test's verdict. The aim is 100,000
characters a second on one core, 50,000 for waveforms.
"""

from __future__ import annotations

import contextlib
import io
import json
import sys
import tempfile
import time
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[2]))

import pandas

from bussim.cli import main
from bussim.export.formats import export_trace
from bussim.trace.file import TRACE, TraceWriter, read_trace
from bussim.trace.records import FrameRecord, TraceBus
from tests.export.samples import LINK, OVEN, exchanges, link_frames, trace
from tests.live.recordings.generator import Sent, pcap

_CHARACTERS = 300_000


def frames_of(bus: TraceBus, characters: int) -> list[FrameRecord]:
    """Frames of so many characters."""
    if bus is LINK:
        return link_frames(characters // 20, damage=0.05)
    return [each for one in exchanges(characters // 22, bus=bus) for each in one.frames]


def recordings(folder: Path, bus: TraceBus, frames: list[FrameRecord]) -> dict[str, Path]:
    """The recordings of a line, by kind."""
    run = folder / "run"
    run.mkdir(parents=True)
    with (run / TRACE).open("w", encoding="utf-8", newline="\n") as file:
        writer = TraceWriter(file, trace(buses=(bus,)).header)
        for frame in frames:
            writer.write(frame)
    found = {"run folder": run}
    for ending in ("sr", "pcapng", "csv"):
        found[ending] = folder / f"line.{ending}"
        export_trace(read_trace(run), found[ending], ending)
    table = pandas.read_csv(found.pop("csv"))
    lines = [f"{end:.9f} {heard}" for end, heard in zip(table["end_s"], table["heard"], strict=True)]
    found["text"] = folder / "line.txt"
    found["text"].write_text("\n".join(lines), encoding="utf-8")
    sent = [Sent(frame.start / 72e6, bytes(frame.chars)) for frame in frames]
    found["pcap"] = pcap(folder / "line.pcap", sent, 148 if bus is LINK else 147)
    return found


def run(characters: int) -> None:
    """Write the recordings of both lines and read each."""
    with tempfile.TemporaryDirectory() as name:
        for bus in (LINK, OVEN):
            frames = frames_of(bus, characters)
            count = sum(len(frame.chars) for frame in frames)
            for kind, path in recordings(Path(name) / bus.name, bus, frames).items():
                out = io.StringIO()
                begun = time.process_time()
                with contextlib.redirect_stdout(out):
                    main(["sniff", str(path), "--json", "-b", str(bus.baud)])
                taken = time.process_time() - begun
                found = json.loads(out.getvalue())
                read = f"{found['protocol']} {found['frames']:,} frames"
                print(
                    f"{kind:<10} {count:>8,} characters {taken:6.2f} s {count / taken:10,.0f} a second  {read}"
                )


if __name__ == "__main__":
    run(int(sys.argv[1]) if len(sys.argv) > 1 else _CHARACTERS)
