"""What ``bussim fit`` reads out of a recording."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

from bussim.commands.common.recording import open_line, read
from bussim.commands.common.times import time_of
from bussim.commands.sniff.tally import described
from bussim.errors import RunError
from bussim.live.fit.link import LinkEstimate, LinkObserver
from bussim.live.fit.modbus import BusEstimate, BusObserver
from bussim.live.recordings.frames import TraceFile
from bussim.live.sniff.link import station_name
from bussim.live.sniff.listener import Listener
from bussim.live.sniff.reading import Settings
from bussim.results.collector import Collector
from bussim.units import TICKS_PER_MS
from bussim.wording import counted

if TYPE_CHECKING:
    from bussim.results.run_record import RunRecord


@dataclass(frozen=True, slots=True)
class Fitted:
    """What was estimated from a recording."""

    bus: str
    names: dict[int, str]
    exact: bool
    duration: int
    link: LinkEstimate | None
    ports: BusEstimate | None
    measured: RunRecord


def fit(
    source: str,
    settings: Settings | None = None,
    *,
    bus: str | None = None,
    tolerance: str | None = None,
) -> Fitted:
    """The estimates of a recording; ``settings`` are what is known of its line.

    Raises UsageError if it cannot be read, RunError if it has no exchange.
    """
    longest = 20 * TICKS_PER_MS if tolerance is None else time_of("--tolerance", tolerance)
    line = open_line(source, settings or Settings(), bus=bus, tolerance=longest)
    protocol, timing = line.found.reading.protocol, line.timing
    if protocol is None:
        found = [*line.found.warnings.values(), *map(described, line.found.described), _HOW]
        raise RunError(f"{source}: " + "\n".join(found))
    sink = Collector(bus_of={line.names.get(0, station_name(0)): line.bus})
    observers = (LinkObserver, BusObserver)
    listener = Listener(line.bus, timing, sink, protocol, decoders=observers, **line.listener_options())
    duration = read(line, listener, None)
    decoder = listener.decoder
    link = decoder.estimate() if isinstance(decoder, LinkObserver) else None
    ports = decoder.estimate() if isinstance(decoder, BusObserver) else None
    if link is None and ports is None:
        raise RunError(
            f"{source}: no exchange was recognised in {counted(listener.characters, 'character')} at "
            f"{timing.baud} bps {timing.format}; {_HOW}"
        )
    where = Path(source).resolve().name[:150]
    if isinstance(line.source, TraceFile) and line.source.header.seed is not None:
        where += " (a simulation)"
    link = link and replace(link, recording=where)
    ports = ports and replace(ports, recording=where)
    totals = listener.totals(duration)
    measured = sink.run(totals, scenario="measured", seed=0)
    return Fitted(line.bus, line.names, line.source.exact, duration, link, ports, measured)


_HOW = "rate and format are set by -b, -d, -P and -s, the protocol by --protocol"
