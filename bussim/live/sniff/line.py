"""Finds out how a recording is read: rate, polarity, format, protocol and channels of its line.

What the user says is obeyed. Where another reading gives more than twice as many sound characters, it is
named beside.
"""

from collections.abc import Iterator
from dataclasses import dataclass, field
from itertools import islice
from typing import Any

from bussim.line.characters import CharFormat, LineTiming
from bussim.live.recordings.errors import RecordingError
from bussim.live.recordings.frames import TraceFile
from bussim.live.recordings.packets import PROTOCOLS, PacketFile
from bussim.live.recordings.sigrok import SigrokFile
from bussim.live.recordings.source import LineSetup, Source
from bussim.live.recordings.text import TextFile
from bussim.live.recordings.waveform import STANDARD
from bussim.live.sniff.channels import Channels
from bussim.live.sniff.heard import LineProtocol
from bussim.live.sniff.reading import SHOWN_CHARS, Reading, Score, Settings, is_tcp, pieces_of, read
from bussim.wording import counted

#: Characters by which a line is found; where they decide nothing, so many.
_EXAMINED, _AT_MOST = 8_000, 200_000


@dataclass(frozen=True, slots=True)
class FoundLine:
    """The line of a recording. ``suggested`` is another reading that fits far better than what was said.

    Where nothing was recognised ``described`` says of every channel what is known. ``likely`` is how the line
    of a session is read then, and where nothing replies.
    """

    reading: Reading
    suggested: Reading | None = None
    described: list[dict[str, Any]] = field(default_factory=list)
    likely: LineSetup | None = None
    warnings: dict[str, str] = field(default_factory=dict)


def find_line(source: Source, settings: Settings, tolerance: int) -> FoundLine:
    """The line of a recording, found as far as it is not said. Raises RecordingError."""
    if isinstance(source, TraceFile):  # says itself what its line is
        timing = LineTiming(
            settings.baud or source.bus.baud, settings.format(CharFormat.parse(source.bus.format))
        )
        given = settings.protocol or (LineProtocol(source.protocol) if source.protocol else None)
        return FoundLine(Reading(settings.setup(timing), given, Score(echo=bool(settings.echo))))
    channels = Channels(source) if isinstance(source, SigrokFile) else None

    def best_of(wanted: Settings) -> Reading:
        return channels.best(wanted) if channels is not None else _best(source, wanted, tolerance)

    best, suggested = best_of(settings), None
    unrestricted = Settings(
        baud=None if channels is not None else settings.baud, echo=settings.echo, layout=settings.layout
    )
    score = best.score
    if settings != unrestricted and (2 * score.sound_characters <= score.characters or not score.responses):
        other = best_of(unrestricted)
        better = 2 * score.sound_characters < other.score.sound_characters
        better = better or score.responses == 0 < other.score.responses
        suggested = other if better and other.score.recognised else None
    if not best.score.recognised and settings.protocol is None:
        best = Reading(best.setup, suggested.protocol if suggested is not None else None, best.score)
    if settings.echo:
        best = Reading(best.setup, best.protocol, best.score._replace(echo=True))
    warnings = dict(_warnings(source, settings, best, suggested))
    described: list[dict[str, Any]] = []
    if not best.score.recognised and suggested is None:
        warnings["not_recognised"] = (
            "no protocol is recognised in it; rate and format are set by -b, -d, -P and -s, the protocol by "
            "--protocol, the wire by --channel"
        )
        described = channels.described() if channels is not None else [_begins(source, best)]
        pieces = [piece for each in described for piece in each.get("pieces", ())]
        if 2 * sum(map(is_tcp, pieces)) > len(pieces):
            warnings["modbus_tcp"] = (
                "these are bytes of Modbus TCP, with a header of seven bytes and no CRC, and of no serial "
                "line: record the one behind the gateway"
            )
        try:
            if channels is not None:
                channels.enough_samples()
        except RecordingError as error:
            warnings["few_samples"] = str(error)
    elif channels is not None and not settings.baud and best.setup.timing.baud not in STANDARD:
        warnings["rate"] = f"{best.setup.timing.baud} bps is not a standard rate"
    if channels is not None and best.score.recognised and suggested is None:
        others = [
            f"{name} ({each.protocol}, {timing.baud} bps {timing.format})"
            for each in channels.others(best)
            for (name,), timing in [(each.setup.channels, each.setup.timing)]
        ]
        if others:
            warnings["other_line"] = f"another line is on channel {'; '.join(others)}: --channel reads it"
    # Polls may be sound in another layout, too: their replies are not.
    unknown = not best.score.recognised or (best.protocol is LineProtocol.NN and not best.score.responses)
    likely = channels.likeliest(settings) if channels is not None and unknown else None
    return FoundLine(best, suggested, described, likely, warnings)


def _warnings(
    source: Source, settings: Settings, best: Reading, suggested: Reading | None
) -> Iterator[tuple[str, str]]:
    timing = best.setup.timing
    if suggested is not None:
        setup = suggested.setup
        yield (
            "wrong_line_settings",
            (
                f"with these settings {best.score.sound_characters:,} characters are in sound frames, with "
                f"{counted(best.score.responses, 'reply')}; {suggested.score.sound_characters:,}, with "
                f"{counted(suggested.score.responses, 'reply')}, are at "
                f"{setup.timing.baud} bps {setup.timing.format}"
                + (", inverted" if setup.inverted else "")
                + (f", channel {', '.join(setup.channels)}" if setup.channels else "")
                + (f" as {suggested.protocol}" if suggested.protocol is not best.protocol else "")
            ),
        )
    if best.protocol is not None and not settings.baud and not rate_of(source):
        yield (
            "assumed_rate",
            (
                f"the recording does not say the rate: {timing.baud} bps is assumed for the load and for the "
                "times of characters; -b sets it"
            ),
        )
    if isinstance(source, TextFile) and source.decimal_comma:
        what = "a decimal comma" if best.setup.decimal_comma else "no decimal comma"
        yield "decimal_comma", f"the times are read with {what}: that gives more sound frames"


def rate_of(source: Source) -> int | None:
    """The rate that a recording says, or that is found in it (a session: always)."""
    if isinstance(source, TraceFile):
        return source.bus.baud
    return source.interface.speed if isinstance(source, PacketFile) else int(isinstance(source, SigrokFile))


def _best(source: Source, settings: Settings, tolerance: int) -> Reading:
    """The best reading of packets or a text, which have characters and no levels."""
    best = max(_readings(source, settings, tolerance, _EXAMINED), key=lambda each: each.score.rank)
    if best.score.recognised or best.score.characters < _EXAMINED:
        return best
    return max(_readings(source, settings, tolerance, _AT_MOST), key=lambda each: each.score.rank)


def _readings(source: Source, settings: Settings, tolerance: int, limit: int) -> Iterator[Reading]:
    given = PROTOCOLS.get(source.interface.link_type) if isinstance(source, PacketFile) else None
    commas = [True, False] if isinstance(source, TextFile) and source.decimal_comma else [False]
    protocols = [LineProtocol(given)] if given else list(LineProtocol)
    for protocol in [settings.protocol] if settings.protocol else protocols:
        errors: list[RecordingError] = []
        for comma in commas:
            timing = settings.timing(protocol, rate_of(source))
            setup = settings.setup(timing, settings.channels, decimal_comma=comma)
            try:
                yield read(
                    source.chunks(setup),
                    setup,
                    protocol,
                    limit,
                    exact=source.exact,
                    tolerance=tolerance if source.tolerant else 0,
                    wires=source.wires,
                )[0]
            except RecordingError as error:
                errors.append(error)
                if len(errors) == len(commas):
                    raise errors[0] from None


def _begins(source: Source, best: Reading) -> dict[str, Any]:
    """How a recording begins in which nothing is recognised."""
    chunks = islice(source.chunks(best.setup), SHOWN_CHARS)
    return {
        "characters": best.score.characters,
        "pieces": pieces_of([char for chunk in chunks for char in chunk.chars]),
    }
