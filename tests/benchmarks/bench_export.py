"""How fast 1,000 frames are exported, in seconds of this process's time, by format.

    python tests/benchmarks/bench_export.py

Frames of an N:N link in refresh mode 2, one in ten damaged, and of a Modbus bus beside it. Nothing is
asserted: a time is no test's verdict. The aim is under two seconds for each format.
"""

from __future__ import annotations

import sys
import tempfile
import time
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[2]))

from bussim.export.formats import FORMATS, export_trace
from bussim.trace.file import TRACE, TraceWriter, read_trace
from tests.export.samples import LINK, OVEN, exchanges, link_frames, trace

_FRAMES = 1000


def main() -> None:
    """Write a trace, read it back and export it in every format."""
    rtu = [each for one in exchanges(200) for each in one.frames]
    frames = sorted([*link_frames(_FRAMES - len(rtu), damage=0.1), *rtu], key=lambda each: each.end)
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        with (folder / TRACE).open("w", encoding="utf-8", newline="\n") as file:
            writer = TraceWriter(file, trace(buses=(LINK, OVEN)).header)
            for frame in frames:
                writer.write(frame)
        for to, form in FORMATS.items():
            begun = time.process_time()
            export_trace(read_trace(folder), folder / f"out{form.ending}", to)
            taken = time.process_time() - begun
            size = (folder / f"out{form.ending}").stat().st_size
            print(f"{to:<9} {len(frames):>6,} frames {taken:6.2f} s {size / 1e3:9,.0f} kB")


if __name__ == "__main__":
    main()
