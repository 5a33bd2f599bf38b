"""Finds out how a recording is read: rate, polarity, format, protocol and channels of its line.

What the user says is obeyed. Where another reading gives more than twice as many sound characters, it is
named beside.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from itertools import islice, pairwise
from typing import Any, NamedTuple

from bussim.line.characters import NN_LINE, CharFormat, LineTiming
from bussim.live.arrival import Timed
from bussim.live.recordings.errors import RecordingError
from bussim.live.recordings.frames import TraceFile
from bussim.live.recordings.packets import PROTOCOLS, PacketFile
from bussim.live.recordings.sigrok import LEAST_SAMPLES, Channel, SigrokFile
from bussim.live.recordings.source import Chunk, LineSetup, Source
from bussim.live.recordings.text import TextFile
from bussim.live.recordings.waveform import Measured, Receiver, measure
from bussim.live.sniff.heard import Heard, LineProtocol, Verdict
from bussim.live.sniff.listener import Listener
from bussim.live.sniff.modbus import ModbusDecoder
from bussim.trace.records import Record

#: Rate and format where nothing gives them (Modbus over serial line, section 2.5.1).
USUAL = {
    LineProtocol.NN: NN_LINE,
    LineProtocol.RTU: LineTiming(19200, CharFormat(8, "E", 1)),
    LineProtocol.ASCII: LineTiming(19200, CharFormat(7, "E", 1)),
}
#: Formats that are tried; of two stop bits it is decided afterwards.
FORMATS = tuple(map(CharFormat.parse, ("8N1", "8E1", "8O1", "7E1", "7O1", "7N1")))
#: Sound frames that settle a protocol; fewer must have half of all characters.
_ENOUGH = 3
#: Characters by which a line is found; where they decide nothing, so many.
_EXAMINED, _AT_MOST = 8_000, 200_000
#: A channel with fewer edges is named, but not tried.
_LEAST_EDGES = 20
#: Pieces that are shown where nothing fits, and how many characters of each.
_SHOWN, _SHOWN_CHARS = 8, 32


@dataclass(frozen=True, slots=True)
class Settings:
    """What the user says of a line; None: it is to be found out."""

    protocol: LineProtocol | None = None
    baud: int | None = None
    data_bits: int | None = None
    parity: str | None = None
    stop_bits: int | None = None
    inverted: bool | None = None
    channels: tuple[str, ...] = ()
    echo: bool | None = None

    def format(self, usual: CharFormat) -> CharFormat:
        """The format that is said, what is not said as usual."""
        return CharFormat(
            self.data_bits or usual.data_bits, self.parity or usual.parity, self.stop_bits or usual.stop_bits
        )

    def allows(self, form: CharFormat) -> bool:
        """Whether a format is not ruled out, its stop bits aside."""
        return self.data_bits in (None, form.data_bits) and self.parity in (None, form.parity)


class Score(NamedTuple):
    """How well a reading fits: characters, those in sound frames, sound frames, responses, wrong bits."""

    characters: int = 0
    sound_characters: int = 0
    sound: int = 0
    responses: int = 0
    wrong: int = 0
    echo: bool = False

    @property
    def recognised(self) -> bool:
        """Whether there are enough sound frames."""
        return self.sound >= _ENOUGH or (self.sound > 0 and 2 * self.sound_characters >= self.characters)

    @property
    def share(self) -> float:
        """The share of characters in sound frames."""
        return self.sound_characters / self.characters if self.characters else 0.0

    @property
    def rank(self) -> tuple[bool, float, int]:
        """What makes one reading better than another."""
        return self.recognised, self.share, -self.wrong


@dataclass(frozen=True, slots=True)
class Reading:
    """A line setup, its protocol (None: not recognised), and how well they fit a recording."""

    setup: LineSetup
    protocol: LineProtocol | None
    score: Score


@dataclass(frozen=True, slots=True)
class FoundLine:
    """The line of a recording. ``suggested`` is another reading that fits far better than what was said.

    ``described`` says of every channel what is known where nothing was recognised.
    """

    reading: Reading
    suggested: Reading | None = None
    described: list[dict[str, Any]] = field(default_factory=list)
    warnings: dict[str, str] = field(default_factory=dict)


class _Nothing:
    """A sink that keeps nothing."""

    traced = False

    def take(self, record: Record) -> None:
        pass

    def failed(self, bus: str, tick: int, station: int, code: int) -> None:
        pass

    def ends(self, plc: str, ticks: Sequence[int]) -> None:
        pass

    def refreshed(self, bus: str, source: int, tick: int, heard: Sequence[int] | None) -> None:
        pass

    def switched(self, bus: str, position: int, tick: int, fresh: int | None) -> None:
        pass


def score(
    chunks: Iterable[Chunk],
    protocol: LineProtocol,
    timing: LineTiming,
    *,
    exact: bool = True,
    tolerance: int = 0,
    wires: int = 1,
    limit: int = _EXAMINED,
    sound: list[Heard] | None = None,
) -> Score:
    """How well a protocol fits characters, at most ``limit`` of them. ``sound`` takes the sound frames."""
    listener = Listener(
        "line", timing, _Nothing(), protocol, exact=exact, tolerance=tolerance, wires=wires, begin=None
    )
    frames = 0
    chunks = iter(chunks)
    more = True
    while more:
        chunk = next(chunks, None)
        more = chunk is not None and listener.characters < limit
        for heard in (
            listener.close() if chunk is None or not more else listener.chars(chunk.chars, chunk.wire)
        ):
            if heard.verdict is Verdict.SOUND:
                frames += 1
                if sound is not None:
                    sound.append(heard)
    decoder = listener.decoder
    return Score(
        listener.characters,
        decoder.sound_characters,
        frames,
        decoder.outcomes["ok"] + decoder.outcomes["exception"],
        decoder.parity_errors + decoder.stop_errors,
        isinstance(decoder, ModbusDecoder) and decoder.echo,
    )


def find_line(source: Source, settings: Settings, tolerance: int) -> FoundLine:
    """The line of a recording, found as far as it is not said. Raises RecordingError."""
    match source:
        case SigrokFile():
            return _in_waveform(source, settings)
        case TraceFile():
            return _of_trace(source, settings)
        case PacketFile():
            given = PROTOCOLS.get(source.interface.link_type)
            rate, commas = source.interface.speed, [False]
        case TextFile():
            given, rate = None, 0
            commas = [True, False] if source.decimal_comma else [False]
        case _:
            raise TypeError(source)

    def readings(wanted: Settings, protocols: Iterable[LineProtocol], limit: int) -> Iterator[Reading]:
        errors: list[RecordingError] = []
        for protocol in protocols:
            usual = USUAL[protocol]
            timing = LineTiming(wanted.baud or rate or usual.baud, wanted.format(usual.format))
            for comma in commas:
                setup = LineSetup(timing, None, settings.channels, comma)
                try:
                    fits = score(
                        source.chunks(setup),
                        protocol,
                        timing,
                        exact=source.exact,
                        tolerance=tolerance if source.tolerant else 0,
                        wires=source.wires,
                        limit=limit,
                    )
                except RecordingError as error:
                    errors.append(error)
                    if len(errors) == len(commas):
                        raise errors[0] from None
                else:
                    yield Reading(setup, protocol, fits)

    known = LineProtocol(given) if given else None
    possible = [known] if known else list(LineProtocol)
    said = [settings.protocol] if settings.protocol else possible
    best = _best(lambda limit: readings(settings, said, limit))
    suggested = None
    if settings.protocol is not None and not best.score.recognised:
        other = _best(lambda limit: readings(settings, possible, limit))
        suggested = other if _far_better(other, best) else None
    warnings: dict[str, str] = {}
    if len(commas) > 1:
        what = "a decimal comma" if best.setup.decimal_comma else "no decimal comma"
        warnings["decimal_comma"] = f"the times are read with {what}: that gives more sound frames"
    return _line(best, suggested, settings, warnings, lambda: [_begins(source, best)])


def _of_trace(source: TraceFile, settings: Settings) -> FoundLine:
    """A trace says itself what its line is."""
    timing = LineTiming(
        settings.baud or source.bus.baud, settings.format(CharFormat.parse(source.bus.format))
    )
    given = settings.protocol or (LineProtocol(source.protocol) if source.protocol else None)
    return FoundLine(Reading(LineSetup(timing), given, Score(echo=bool(settings.echo))))


def _begins(source: Source, best: Reading) -> dict[str, Any]:
    """How a recording begins in which nothing is recognised."""
    chunks = islice(source.chunks(best.setup), _SHOWN_CHARS)
    chars = [char for chunk in chunks for char in chunk.chars]
    return {"characters": best.score.characters, "pieces": _pieces(chars)}


def _best(readings: Callable[[int], Iterable[Reading]]) -> Reading:
    best = max(readings(_EXAMINED), key=lambda each: each.score.rank)
    if best.score.recognised or best.score.characters < _EXAMINED:
        return best
    return max(readings(_AT_MOST), key=lambda each: each.score.rank)


def _far_better(other: Reading, than: Reading) -> bool:
    return other.score.recognised and than.score.sound_characters * 2 < other.score.sound_characters


def _line(
    best: Reading,
    suggested: Reading | None,
    settings: Settings,
    warnings: dict[str, str],
    describe: Callable[[], list[dict[str, Any]]],
) -> FoundLine:
    """What is reported of the best reading: its protocol only if it is said or recognised."""
    if suggested is not None:
        setup = suggested.setup
        warnings["wrong_line_settings"] = (
            f"with these settings {best.score.sound_characters:,} characters are in sound frames; "
            f"{suggested.score.sound_characters:,} are at {setup.timing.baud} bps {setup.timing.format}"
            + (", inverted" if setup.inverted else "")
            + (f", channel {', '.join(setup.channels)}" if setup.channels else "")
        )
    if not best.score.recognised and settings.protocol is None:
        protocol = suggested.protocol if suggested is not None else None
        best = Reading(best.setup, protocol, best.score)
    described: list[dict[str, Any]] = []
    if not best.score.recognised and suggested is None:
        warnings["not_recognised"] = "no protocol is recognised in it"
        described = describe()
    if settings.echo:
        best = Reading(best.setup, best.protocol, best.score._replace(echo=True))
    return FoundLine(best, suggested, described, warnings)


# -- waveforms -------------------------------------------------------------------------------------------


class _Wire(NamedTuple):
    """A channel that may be a line."""

    name: str
    channel: Channel
    measured: Measured | None


def _in_waveform(source: SigrokFile, settings: Settings) -> FoundLine:
    channels = source.survey()
    names = settings.channels or tuple(channels)
    wires = [
        _Wire(name, channels[name], measure(channels[name].edges, source.rate, source.samples))
        for name in channels
        if channels[name].total >= _LEAST_EDGES
    ]
    own = [wire for wire in wires if wire.name in names]
    best = _of_wires(source, own, settings)
    suggested = None
    restricted = settings != Settings(echo=settings.echo)
    if restricted and (best is None or 2 * best.score.sound_characters < best.score.characters):
        other = _of_wires(source, wires, Settings())
        if other is not None and (best is None or _far_better(other, best)):
            suggested = other if other.score.recognised else None
    warnings: dict[str, str] = {}
    if best is None:
        for wire in own:
            if wire.measured and wire.measured.standard and wire.measured.fits:
                source.enough_samples(settings.baud or wire.measured.baud, f"channel {wire.name}: ")
        timing = _usual(settings)
        best = Reading(LineSetup(timing, bool(settings.inverted), names[:1]), settings.protocol, Score())
    measured = {wire.name: wire.measured for wire in wires}
    found = measured.get(best.setup.channels[0])
    if found is not None and not found.standard and best.score.recognised and not settings.baud:
        warnings["rate"] = f"{found.baud} bps is not a standard rate"
    return _line(
        best,
        suggested,
        settings,
        warnings,
        lambda: [_description(source, name, channels[name], measured.get(name)) for name in channels],
    )


def _usual(settings: Settings) -> LineTiming:
    usual = USUAL[settings.protocol or LineProtocol.NN]
    return LineTiming(settings.baud or usual.baud, settings.format(usual.format))


def _of_wires(source: SigrokFile, wires: Sequence[_Wire], settings: Settings) -> Reading | None:
    """The best reading of channels: one that has both directions, or several with one each."""
    readings = [found for wire in wires if (found := _of_wire(source, wire, settings)) is not None]
    if not readings:
        return None
    best = max(
        readings, key=lambda each: (each.score.recognised, each.score.responses > 0, *each.score.rank[1:])
    )
    alike = [
        each
        for each in readings
        if each.score.recognised
        and (each.setup.timing, each.setup.inverted, each.protocol)
        == (best.setup.timing, best.setup.inverted, best.protocol)
    ]
    if len(alike) < 2 or best.protocol is None:
        return best
    setup = best.setup._replace(channels=tuple(each.setup.channels[0] for each in alike))
    fits = score(source.chunks(setup), best.protocol, setup.timing, wires=len(alike))
    # Where one channel has both directions, others repeat a part of it.
    several = len(settings.channels) > 1 or fits.responses > 2 * best.score.responses
    return Reading(setup, best.protocol, fits) if several else best


def _of_wire(source: SigrokFile, wire: _Wire, settings: Settings) -> Reading | None:
    measured = wire.measured
    baud = settings.baud or (measured.baud if measured and measured.fits else None)
    if baud is None or source.rate < LEAST_SAMPLES * baud:
        return None
    levels = [settings.inverted]
    if settings.inverted is None:
        levels = [False, True] if measured is None or measured.inverted is None else [measured.inverted]
    found = [
        Reading(LineSetup(timing, inverted, (wire.name,)), protocol, fits)
        for inverted in levels
        for form in FORMATS
        if settings.allows(form)
        for timing in [LineTiming(baud, CharFormat(form.data_bits, form.parity, settings.stop_bits or 1))]
        for protocol, fits in _scores(source, wire.channel, timing, settings, inverted=bool(inverted))
    ]
    if not found:
        return None
    best = max(found, key=lambda each: each.score.rank)
    return best if settings.stop_bits or not best.score.recognised else _stop_bits(source, wire, best)


def _received(source: SigrokFile, channel: Channel, timing: LineTiming, *, inverted: bool) -> list[Timed]:
    """The characters of the edges by which a line is found."""
    receiver = Receiver(timing, source.rate, inverted=inverted)
    edges = channel.edges.tolist()
    return receiver.feed(edges, source.samples if channel.total == len(edges) else edges[-1])


def _scores(
    source: SigrokFile, channel: Channel, timing: LineTiming, settings: Settings, *, inverted: bool
) -> Iterator[tuple[LineProtocol, Score]]:
    """How well each protocol fits that has characters of this format."""
    form = timing.format
    chars = _received(source, channel, timing, inverted=inverted)
    for protocol in [settings.protocol] if settings.protocol else LineProtocol:
        fitting = form.data_bits == USUAL[protocol].format.data_bits
        if fitting or settings.protocol or (protocol is LineProtocol.ASCII and form.parity == "N"):
            yield protocol, score([Chunk(chars)], protocol, timing, limit=len(chars) + 1)


def _stop_bits(source: SigrokFile, wire: _Wire, best: Reading) -> Reading:
    """The reading with two stop bits, if no character of a sound frame begins before they are over."""
    timing, form = best.setup.timing, best.setup.timing.format
    chars = _received(source, wire.channel, timing, inverted=bool(best.setup.inverted))
    frames: list[Heard] = []
    if best.protocol is not None:
        score([Chunk(chars)], best.protocol, timing, limit=len(chars) + 1, sound=frames)
    ends = {heard.end for heard in frames}
    starts = iter(sorted((heard.start, heard.end) for heard in frames))
    inside, apart = next(starts, None), []
    for (_, start, end), (_, after, _) in pairwise(chars):
        while inside is not None and start >= inside[1]:
            inside = next(starts, None)
        if inside is not None and inside[0] <= start and end not in ends:
            apart.append(after - start)
    if not apart or min(apart) < timing.bits(form.bits) + timing.bits(1) // 2:
        return best
    two = LineTiming(timing.baud, CharFormat(form.data_bits, form.parity, 2))
    return Reading(best.setup._replace(timing=two), best.protocol, best.score)


def _description(
    source: SigrokFile, name: str, channel: Channel, measured: Measured | None
) -> dict[str, Any]:
    """What is known of a channel in which nothing is recognised."""
    found: dict[str, Any] = {"channel": name, "edges": channel.total}
    if measured is None:
        return found
    inverted = bool(measured.inverted)
    found |= {"idle_level": int(not inverted), "baud": measured.baud}
    tried = []
    for form in FORMATS:
        timing = LineTiming(measured.baud, form)
        chars = _received(source, channel, timing, inverted=inverted)
        wrong = sum(not (char.parity_ok and char.stop_ok) for char, _, _ in chars)
        tried.append((wrong / len(chars) if chars else 1.0, str(form), chars))
    tried.sort(key=lambda each: each[0])
    found["characters"] = len(tried[0][2])
    found["wrong_share"] = {form: round(share, 4) for share, form, _ in tried[:3]}
    found["pieces"] = _pieces(tried[0][2])
    return found


def _pieces(chars: Sequence[Timed]) -> list[str]:
    """The first characters in hexadecimal, a text for what lies between two silences."""
    pieces: list[bytearray] = []
    before = None
    for (value, _, _), start, end in chars:
        if before is None or start - before > 3 * (end - start):
            if len(pieces) == _SHOWN:
                break
            pieces.append(bytearray())
        if len(pieces[-1]) < _SHOWN_CHARS:
            pieces[-1].append(value)
        before = end
    return [bytes(piece).hex(" ") for piece in pieces]
