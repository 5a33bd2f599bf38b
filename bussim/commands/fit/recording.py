"""What ``bussim fit`` reads out of a recording."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

from bussim.commands.common.recording import open_line, read
from bussim.commands.common.scenario_options import time_of
from bussim.commands.sniff.tally import described
from bussim.commands.sniff.warnings import warnings_of
from bussim.errors import RunError
from bussim.line.characters import LineTiming
from bussim.live.fit.comparison import Behaviour
from bussim.live.fit.link import LinkEstimate, LinkObserver
from bussim.live.fit.modbus import BusEstimate, BusObserver
from bussim.live.fit.noise import NoiseEstimate
from bussim.live.fit.outages import Losses
from bussim.live.recordings.frames import TraceFile
from bussim.live.recordings.source import LineSetup, Progress
from bussim.live.sniff.heard import LineProtocol
from bussim.live.sniff.link import station_name
from bussim.live.sniff.listener import Listener
from bussim.live.sniff.reading import Settings
from bussim.results.collector import Collector
from bussim.units import TICKS_PER_MS, seconds
from bussim.wording import counted, visible

if TYPE_CHECKING:
    from bussim.results.run_record import RunRecord
    from bussim.scenario.model import Scenario


@dataclass(frozen=True, slots=True)
class Fitted:
    """What was estimated from a recording: of its link or of its ports. ``resolution``: that of its times."""

    bus: str
    names: dict[int, str]
    exact: bool
    duration: int
    resolution: int
    timed: bool
    protocol: LineProtocol
    timing: LineTiming
    link: LinkEstimate | None
    ports: BusEstimate | None
    measured: RunRecord
    warnings: dict[str, str]  # of the recording and its line, by code

    @property
    def noise(self) -> NoiseEstimate:
        """The noise of the line."""
        return self._either.noise

    @property
    def behaviour(self) -> Behaviour:
        """What the line did."""
        return self._either.behaviour

    @property
    def losses(self) -> list[Losses]:
        """What became of the requests to each station."""
        found = self._either
        return [each.losses for each in (found.stations if isinstance(found, LinkEstimate) else found.slaves)]

    @property
    def _either(self) -> LinkEstimate | BusEstimate:
        found = self.link or self.ports
        assert found is not None  # noqa: S101 - narrows the type
        return found


def fit(
    source: str,
    settings: Settings | None = None,
    *,
    bus: str | None = None,
    tolerance: str | None = None,
    progress: Progress | None = None,
) -> Fitted:
    """The estimates of a recording; ``settings`` are what is known of its line.

    ``progress`` shows how much of it is read.

    Raises UsageError if it cannot be read, RunError if it has no exchange.
    """
    longest = 20 * TICKS_PER_MS if tolerance is None else time_of("--tolerance", tolerance)
    line = open_line(source, settings or Settings(), bus=bus, tolerance=longest, progress=progress)
    protocol, timing = line.found.reading.protocol, line.timing
    if line.misfit is not None:
        raise RunError(f"{source}: {line.misfit.text}; {_LAYOUT}")
    if protocol is None:
        found = [*line.found.warnings.values(), *map(described, line.found.described)]
        raise RunError(f"{source}: " + "\n".join(found))
    sink = Collector(bus_of={line.names.get(0, station_name(0)): line.bus})
    listener = Listener(line.bus, timing, sink, protocol, decoders=_OBSERVERS, **line.listener_options())
    duration = read(line, listener, None, _MOST_FRAMES)
    resolution, timed = line.source.resolution, line.source.times != "none"
    link, ports = _estimates(listener, duration, resolution, timed=timed)
    if link is None and ports is None:
        raise RunError(
            f"{source}: no exchange was recognised in {counted(listener.characters, 'character')} at "
            f"{timing.baud} bps {timing.format}; {_HOW}"
        )
    warnings = warnings_of(listener, line)
    if listener.decoder.frames >= _MOST_FRAMES:
        part = f"first {_MOST_FRAMES:,} frames, {seconds(duration):,.0f} s"
        warnings["too_long"] = f"the estimates are of its {part}: what follows is left out"
    where = visible(Path(source).resolve().name)[:150]
    if isinstance(line.source, TraceFile) and line.source.header.seed is not None:
        where += " (a simulation)"
    return Fitted(
        line.bus,
        line.names,
        line.source.exact,
        duration,
        resolution,
        timed,
        protocol,
        timing,
        link and replace(link, recording=where),
        ports and replace(ports, recording=where),
        sink.run(listener.totals(duration), scenario="measured", seed=0),
        warnings,
    )


def simulate(scenario: Scenario, fitted: Fitted) -> tuple[RunRecord, Behaviour] | None:
    """A run of the estimates, and what a recorder of its line would have seen; None where that is nothing."""
    from bussim import api

    result = api.run(scenario, rows=False, trace=True)
    trace = result.open_trace()
    source = TraceFile(trace, trace.bus(fitted.bus))
    listener = Listener(fitted.bus, fitted.timing, Collector(), fitted.protocol, decoders=_OBSERVERS)
    for chunk in source.chunks(LineSetup(fitted.timing)):
        listener.chars(chunk.chars)
    listener.close(source.end())
    link, ports = _estimates(listener, scenario.duration, source.resolution, timed=True)
    found = link or ports
    return None if found is None or not found.behaviour.times else (result.record, found.behaviour)


def _estimates(
    listener: Listener, duration: int, resolution: int, *, timed: bool
) -> tuple[LinkEstimate | None, BusEstimate | None]:
    decoder = listener.decoder
    link = decoder.estimate(resolution) if isinstance(decoder, LinkObserver) else None
    ports = decoder.estimate(resolution, duration, timed=timed) if isinstance(decoder, BusObserver) else None
    return link, ports


#: So many frames are kept at most, which takes half a gigabyte.
_MOST_FRAMES = 2_000_000
_OBSERVERS = (LinkObserver, BusObserver)
_LAYOUT = (
    "without the layout there is no error rate: bussim sniff --propose FILE writes the one that is proposed, "
    "--layout FILE reads by it"
)
_HOW = "rate and format are set by -b, -d, -P and -s, the protocol by --protocol"
