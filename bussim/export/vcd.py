"""Value Change Dump (IEEE 1364, section 18): the waveform for PulseView, GTKWave and others.

Time counts in microseconds from the run's start (where a frame begins with the window: later by the idle line
before it). Each bus is a scope with its own lane and one for
each transmitter, see :mod:`bussim.export.lanes`.
"""

from pathlib import Path
from typing import Any

from bussim.export.lanes import Lanes, by_scope, unspaced
from bussim.version import __version__


def write_vcd(path: Path, lanes: Lanes, comment: str) -> None:
    """Write the lanes; memory does not depend on their length."""
    from vcd import VCDWriter
    from vcd.writer import Variable

    with path.open("w", encoding="utf-8", newline="\n") as file:
        writer = VCDWriter(
            file,
            timescale="1 us",
            date="",  # the same bytes for the same run
            version=f"bussim {__version__}",
            comment=comment.replace("$", "_"),  # a word that begins with $ would end the comment
            check_values=False,
            init_timestamp=lanes.begin,
        )
        wires: dict[int, Variable[Any]] = {}
        for scope, members in by_scope(lanes.lanes).items():
            for number in members:
                name = lanes.lanes[number].name
                wires[number] = writer.register_var(unspaced(scope), name, "wire", size=1, init=1)
        change = writer.change
        for us, lane, level in lanes.changes():
            change(wires[lane], us, level)
        writer.close(lanes.end)
