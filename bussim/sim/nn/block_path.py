"""Many ordinary link scans at once, where nothing can come between.

From the master's data frame on, as long as every station is in step, chance damages nothing, and SimPy's next
event lies later, link scans are ordinary. How many follow is asked of the random streams, which are looked at
without being taken from; the engines know when they happen and what they leave
(:mod:`bussim.engines.nn.ordinary`). What else would have been done meanwhile is done here: draws are taken,
frames counted, the blocks kept that some END may still ask for, records made. A run has the same results to
the last byte with and without, which a test compares.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from itertools import chain, islice, repeat, zip_longest
from typing import TYPE_CHECKING, NamedTuple

from bussim.engines.nn.frames import DATA, KIND_NAMES, POLL, POLL_CHARS, data_chars, encode_data, encode_poll
from bussim.engines.nn.master import Master
from bussim.engines.nn.ordinary import OrdinaryScans, ordinary_scans
from bussim.engines.nn.slave import Slave
from bussim.sim.kernel import HEARING, SENDING, Kernel
from bussim.sim.nn.contract import LinkStation
from bussim.sim.wire.contract import Transmission
from bussim.sim.wire.disturber import FramesAhead
from bussim.trace.blocks import Alike

if TYPE_CHECKING:
    import numpy as np

    from bussim.engines.nn.frames import Frame
    from bussim.sim.nn.bus import LinkBus

#: Most scans of one block: a compromise of memory and speed.
_MOST = 1024


class _Stations(NamedTuple):
    """The stations of a link in step: the slaves that are polled in order, and all that receive."""

    port: LinkStation
    master: Master
    polled: list[LinkStation]
    slaves: list[Slave]
    receiving: list[LinkStation]
    reading: bool  # whether blocks may change what some PLC's ENDs do


class BlockPath:
    """The blocks of one bus."""

    def __init__(self, bus: LinkBus, kernel: Kernel) -> None:
        self._bus = bus
        self._kernel = kernel
        self._poll = POLL_CHARS * bus.character
        self._bit = bus.timing.bit
        self._hit_at = -1  # when a scan begins that chance disturbs

    def pass_scans(self, port: LinkStation, now: int) -> bool:
        """Do the ordinary scans that a master begins now; False: nothing was done."""
        bus, kernel, master = self._bus, self._kernel, port.engine
        if not bus.in_blocks or type(master) is not Master or not master.ordinary or now == self._hit_at:
            return False
        stations = self._in_step(port, master)
        if stations is None:
            return False
        bus.deadlines.cancel()  # to learn what else comes next
        parts = [] if stations.reading else [part.timers for part in bus.parts if part.is_independent]
        timers = {*chain.from_iterable(parts), *bus.recording}
        until = min(kernel.next(timers), bus.disturber.calm_until(now))
        if stations.reading:
            until = min([until, *self._same_until(stations, now)])
        scans = self._scans(stations, now, until)
        if scans is not None:
            self._pass(stations, scans, now)
        bus.rewatch()
        return scans is not None

    # -- how far -----------------------------------------------------------------------------------

    def _in_step(self, port: LinkStation, master: Master) -> _Stations | None:
        """The stations, if every one is ready for an ordinary scan."""
        if self._bus.drivers or not self._bus.whole:
            return None
        by_station: dict[int, LinkStation] = {}
        slaves: list[Slave] = []
        receiving: list[LinkStation] = []
        reading = False
        for other in self._bus.ports:
            engine = other.engine
            if engine is None:
                continue
            if not (other.nominal and other.undelayed):
                return None
            receiving.append(other)
            reading = reading or other.plc.reads_blocks
            if other is port:
                continue
            if not isinstance(engine, Slave) or not engine.in_step(master):
                return None
            by_station[engine.config.station] = other
            slaves.append(engine)
        numbers = range(1, master.config.settings.slaves + 1)
        if len(by_station) < len(slaves) or not by_station.keys() >= set(numbers):
            return None
        polled = [by_station[number] for number in numbers]
        return _Stations(port, master, polled, slaves, receiving, reading)

    def _same_until(self, stations: _Stations, now: int) -> Iterator[int]:
        """Until when each station's block is the one that all have received last; now: it is another."""
        for station, other in enumerate((stations.port, *stations.polled)):
            news = self._bus.block_history.is_news(station, other.plc.image_at(now))
            yield now if news else other.plc.image_until

    def _scans(self, stations: _Stations, now: int, until: int) -> OrdinaryScans | None:
        """The ordinary scans from now on whose last reply ends before ``until``, in one block; None: none."""
        import numpy as np

        disturber, config, polled = self._bus.disturber, stations.master.config, stations.polled
        data = data_chars(config.settings.mode) * self._bus.character
        shortest, longest = ([turnaround(port) for port in polled] for turnaround in (_shortest, _longest))
        least = data + sum(shortest) + len(polled) * (config.gap + self._poll + data)
        # From one frame of the master to the next: the reply between them, or the last one and what follows.
        silence = max(longest) + data + max(config.gap + self._poll, config.overhead + config.gap + data)
        if (
            now + least >= until
            or max(longest) + data > config.timeout
            or silence >= min(slave.watchdog for slave in stations.slaves)
        ):
            return None
        most = wanted = min(_MOST, (until - now) // least + 1)
        for port in polled:
            most = disturber.replies_kept(port.position, now, most)
        if disturber.active:
            starts = np.broadcast_to(np.int64(now), most)
            most = self._kept(stations, [starts] * (1 + 2 * len(polled)), varying=False)
        if not most:
            return None
        kept = most
        turnarounds = np.array([port.turnarounds.ahead(most) for port in polled])
        scans = ordinary_scans(config, stations.master.counter, now, turnarounds, self._poll, data)
        most = over = int(scans.replied[-1].searchsorted(until))
        if disturber.active and most:
            most = self._kept(stations, _starts(scans.first(most)), varying=True)
        if most < over or over == kept < wanted:
            self._hit_at = int(scans.starts[most])
        return scans.first(most) if most else None

    def _kept(self, stations: _Stations, starts: Sequence[np.ndarray], *, varying: bool) -> int:
        """In how many scans no frame is damaged, by noise whose rate varies, or else does not."""
        most = len(starts[0])
        for frames in self._frames(stations, starts):
            coming = frames._replace(starts=frames.starts[:most])
            most = self._bus.disturber.frames_kept(coming, varying=varying)
            if not most:
                break
        return most

    def _frames(self, stations: _Stations, starts: Sequence[np.ndarray]) -> list[FramesAhead]:
        """The frames of each scan in order, from the master's data frame on, which begin at ``starts``."""
        bus, port = self._bus, stations.port
        timing = bus.timing
        data = data_chars(stations.master.config.settings.mode) * timing.format.bits
        poll = POLL_CHARS * timing.format.bits
        frames = [(port, DATA, 0, data)]
        for station, other in enumerate(stations.polled, 1):
            frames += [(port, POLL, station, poll), (other, DATA, station, data)]
        return [
            FramesAhead(sender.position, f"{sender.name} {KIND_NAMES[kind]} {station}", at, bits, self._bit)
            for (sender, kind, station, bits), at in zip(frames, starts, strict=True)
        ]

    # -- what remains ------------------------------------------------------------------------------

    def _pass(self, stations: _Stations, scans: OrdinaryScans, now: int) -> None:
        port, master, polled, slaves, *_ = stations
        bus, number = self._bus, scans.number
        bus.frames += number * (1 + 2 * scans.slaves)
        bus.busy += number * (scans.data + scans.slaves * (scans.poll + scans.data))
        for other in polled:
            other.turnarounds.skip(number)
            bus.disturber.pass_replies(other.position, now, number)
        if bus.disturber.active:
            for frames in self._frames(stations, _starts(scans)):
                bus.disturber.pass_frames(frames, number, now)
        for slave in slaves:
            slave.pass_scans(scans)
        self._record(stations, scans, now)
        self._kernel.now = scans.end
        port.handle(master.pass_scans(scans), scans.end)

    def _record(self, stations: _Stations, scans: OrdinaryScans, now: int) -> None:
        """Keep the blocks that some END may still ask for, and tell what has happened."""
        port, master, polled, _, receiving, *_ = stations
        bus = self._bus
        missed = [other.position for other in bus.ports if other not in receiving]
        # The first scan begins: the one before is over.
        master.image = port.plc.image_at(now)
        frame = master.begin_transmit(now)
        begun = (scans.starts[:-1], *scans.replies)
        senders = (port, *polled)
        images: list[dict[int, bytes]] = [{} for _ in senders]
        if bus.sink.traced:
            for sender, starts, found in zip(senders, begun, images, strict=True):
                found.update((start, sender.plc.image_at(start)) for start in starts.tolist())
            self._trace(stations, scans, frame, images)
        else:
            port.drain(now + scans.data)
            if columns := bus.reporter.scans(port, scans.starts[:-1], scans.slaves):
                bus.sink.take_many(columns)
        took = [other.position for other in receiving] if missed else None
        old = scans.end - bus.block_history.horizon
        # Every END to come finds a block of a scan that was over by then: no scan of a PLC lasts longer.
        first = max(0, int(scans.starts.searchsorted(old, side="right")) - 2)
        kept: list[list[int]] = []
        for sender, starts in zip(senders, begun, strict=True):
            kept.append(_latest(starts[first:].tolist(), old - scans.data))
            heard = None if took is None else [each for each in took if each != sender.position]
            bus.sink.refreshed_often(bus.name, sender.position, starts + scans.data, heard)
        # Keep the blocks that are sent at these ticks; meanwhile independent parts go on. What a port has
        # written into a block shows in the frame after it.
        asked = sorted(
            (start, station)
            for station, (sender, starts, wanted) in enumerate(zip(senders, begun, kept, strict=True))
            for start in (wanted if sender.plc.ports_apart else starts.tolist())
            if bus.parts
        )
        for start, station in asked:
            self._kernel.pass_events(start, SENDING)
            images[station][start] = senders[station].plc.image_at(start)
        if asked:
            self._kernel.pass_events(scans.end, 0)
        for station, sender in enumerate(senders):
            for start in kept[station]:
                image = images[station].get(start) or sender.plc.image_at(start)
                bus.block_history.received(station, start + scans.data, image, missed)
            if kept[station] and sender.engine is not None:
                sender.engine.image = image

    def _trace(
        self, stations: _Stations, scans: OrdinaryScans, frame: Frame, images: Sequence[dict[int, bytes]]
    ) -> None:
        """Record frames, attempts and link scans; ``frame`` is the first, blocks are by their first edge."""
        import numpy as np

        port, _, polled, *_ = stations
        bus, start = self._bus, int(scans.starts[0])
        end = start + scans.data
        self._kernel.pass_events(end, HEARING)
        bus.record(Transmission(port, frame, frame.chars, start, end, port.timing))
        port.drain(end)
        counters = scans.counter + np.arange(scans.number) & 15
        columns: list[Alike] = []

        def frames(station: int) -> Iterator[Frame]:
            return map(encode_data, repeat(station), counters.tolist(), images[station].values())

        for station, other in enumerate(polled, 1):
            times = [each[station - 1] for each in (scans.polled, scans.replies, scans.replied)]
            starts = times[0] - scans.poll
            polls = map(encode_poll, repeat(station), counters.tolist())
            columns.append(self._alike(port, polls, starts, counters))
            columns += bus.reporter.attempts(port, station, starts, *times)
            columns.append(self._alike(other, frames(station), times[1], counters))
        if scans.number > 1:
            later = scans.starts[1:-1]
            columns.append(self._alike(port, islice(frames(0), 1, None), later, counters[1:]))
            columns += bus.reporter.scans(port, scans.starts[:-1], scans.slaves)
        # A link scan is recorded with the data frame after it.
        ends = [each.varying.get("end", scans.starts[1:-1] + scans.data) for each in columns]
        bus.sink.take_many(columns, self._breaks(np.sort(np.concatenate(ends))))
        self._kernel.pass_events(scans.end, HEARING)  # what no sink that keeps the order has asked for

    def _alike(
        self, sender: LinkStation, frames: Iterable[Frame], starts: np.ndarray, counters: np.ndarray
    ) -> Alike:
        """The records of a sender's frames of one kind."""
        import numpy as np

        first, *_ = frames = list(frames)
        tx = Transmission(sender, first, first.chars, 0, 0, sender.timing)
        ends = starts + len(tx.chars) * self._bus.character
        chars = np.array([frame.chars for frame in frames], object)
        varying = {"start": starts, "end": ends, "counter": counters, "chars": chars}
        return Alike(self._bus.frame_record(tx), varying)

    def _breaks(self, ticks: np.ndarray) -> Iterator[int]:
        """The indexes of records, made at these ticks, before which something else is recorded."""
        while (event := self._kernel.next()) < ticks[-1]:
            yield int(ticks.searchsorted(event, side="right"))
            self._kernel.pass_events(event, SENDING)


def _latest(starts: Sequence[int], old: int) -> list[int]:
    """The latest of some ticks up to ``old``, and those after it."""
    return [start for start, after in zip_longest(starts, starts[1:]) if after is None or after > old]


def _shortest(port: LinkStation) -> int:
    return port.turnarounds.shortest


def _longest(port: LinkStation) -> int:
    return port.turnarounds.longest


def _starts(scans: OrdinaryScans) -> list[np.ndarray]:
    """The first edges of the frames of each scan, in order."""
    rows = [scans.starts[:-1]]
    for polled, replies in zip(scans.polled, scans.replies, strict=True):
        rows += [polled - scans.poll, replies]
    return rows
