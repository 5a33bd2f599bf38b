"""What ``bussim fit`` reads out of a recording."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from bussim.commands.common.recording import known_line, read
from bussim.commands.common.times import time_of
from bussim.errors import UsageError
from bussim.line.characters import LineTiming
from bussim.live.fit.link import LinkEstimate, LinkObserver
from bussim.live.fit.modbus import BusEstimate, BusObserver
from bussim.live.recordings.open import Kind, kind_of
from bussim.live.sniff.link import station_name
from bussim.live.sniff.listener import Listener
from bussim.results.collector import Collector
from bussim.units import TICKS_PER_MS
from bussim.wording import counted

if TYPE_CHECKING:
    from bussim.live.sniff.heard import LineProtocol
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
    line: LineTiming,
    *,
    protocol: LineProtocol | None = None,
    bus: str | None = None,
    channel: str | None = None,
    tolerance: str | None = None,
) -> Fitted:
    """The estimates of a recording. Raises UsageError if it cannot be read or has no exchange."""
    path, kind = Path(source), kind_of(Path(source))
    known = known_line(source, kind, line, bus)
    line = known.timing
    gap = 20 * TICKS_PER_MS if kind is Kind.RAW else 0
    if tolerance is not None:
        gap = time_of("--tolerance", tolerance)
    sink = Collector(bus_of={known.names.get(0, station_name(0)): known.bus})
    listener = Listener(
        known.bus,
        line,
        sink,
        tolerance=gap,
        protocol=protocol,
        names=known.names,
        decoders=(LinkObserver, BusObserver),
    )
    duration = read(path, kind, listener, channel, None)
    decoder = listener.decoder
    link = decoder.estimate() if isinstance(decoder, LinkObserver) else None
    ports = decoder.estimate() if isinstance(decoder, BusObserver) else None
    if link is None and ports is None:
        raise UsageError(
            f"{source}: no exchange was recognised in {counted(listener.characters, 'character')} at "
            f"{line.baud} bps {line.format}; rate and format are set by -b, -d, -P and -s, the protocol by "
            "--protocol"
        )
    totals = listener.totals(max(duration, listener.last))
    measured = sink.run(totals, scenario="measured", seed=0)
    return Fitted(known.bus, known.names, known.exact, totals.duration, link, ports, measured)
