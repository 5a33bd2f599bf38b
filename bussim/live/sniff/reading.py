"""What is said of a line, ways to read a recording of it, and how well each fits."""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field
from itertools import takewhile
from typing import NamedTuple, cast

from bussim.line.characters import NN_LINE, CharFormat, LineTiming
from bussim.live.arrival import Timed
from bussim.live.layout.value import ASSUMED, Layout
from bussim.live.recordings.source import Chunk, LineSetup
from bussim.live.sniff.heard import Heard, LineProtocol, Verdict
from bussim.live.sniff.listener import Listener
from bussim.live.sniff.modbus import ModbusDecoder
from bussim.trace.sink import Sink

#: Rate and format where nothing gives them (Modbus over serial line, section 2.5.1).
USUAL = {
    LineProtocol.NN: NN_LINE,
    LineProtocol.RTU: LineTiming(19200, CharFormat(8, "E", 1)),
    LineProtocol.ASCII: LineTiming(19200, CharFormat(7, "E", 1)),
}
#: Pieces that are shown where nothing fits, and how many characters of each.
_SHOWN, SHOWN_CHARS = 8, 32
#: Sound frames that settle a protocol; fewer must have half of all characters.
_ENOUGH = 3


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
    layout: Layout = ASSUMED

    def timing(self, protocol: LineProtocol | None, baud: int | None = None) -> LineTiming:
        """Rate and format: what is said, else as usual for a protocol (None: N:N, without parity RTU)."""
        likely = LineProtocol.RTU if self.parity == "N" else LineProtocol.NN
        usual = USUAL[self.protocol or protocol or likely]
        return LineTiming(self.baud or baud or usual.baud, self.format(usual.format))

    def setup(
        self,
        timing: LineTiming,
        channels: tuple[str, ...] = (),
        *,
        inverted: bool | None = None,
        decimal_comma: bool = False,
    ) -> LineSetup:
        """How a recording is read with these settings."""
        return LineSetup(timing, inverted, channels, decimal_comma, self.layout)

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
    def rank(self) -> tuple[bool, float, int]:
        """What makes one reading better than another."""
        return self.recognised, self.sound_characters / max(1, self.characters), -self.wrong


@dataclass(frozen=True, slots=True)
class Reading:
    """A line setup, its protocol (None: not recognised), and how well they fit a recording."""

    setup: LineSetup
    protocol: LineProtocol | None
    score: Score = field(default_factory=Score)


class _Nothing:
    traced = False

    def __getattr__(self, _: str) -> Callable[..., None]:
        return lambda *_, **__: None


def read(
    chunks: Iterable[Chunk],
    setup: LineSetup,
    protocol: LineProtocol,
    limit: int,
    *,
    exact: bool = True,
    tolerance: int = 0,
    wires: int = 1,
) -> tuple[Reading, list[Heard]]:
    """A reading of at most about ``limit`` characters, and its sound frames; else as :class:`Listener`."""
    listener = Listener(
        "line",
        setup.timing,
        cast("Sink", _Nothing()),
        protocol,
        exact=exact,
        tolerance=tolerance,
        wires=wires,
        begin=None,
        layout=setup.layout,
    )
    heard = [
        each
        for chunk in takewhile(lambda _: listener.characters < limit, chunks)
        for each in listener.chars(chunk.chars, chunk.wire)
    ]
    sound = [each for each in heard + listener.close() if each.verdict is Verdict.SOUND]
    decoder = listener.decoder
    score = Score(
        listener.characters,
        decoder.sound_characters,
        len(sound),
        decoder.outcomes["ok"] + decoder.outcomes["exception"],
        decoder.parity_errors + decoder.stop_errors,
        isinstance(decoder, ModbusDecoder) and decoder.echo,
    )
    return Reading(setup, protocol, score), sound


def pieces_of(chars: Sequence[Timed]) -> list[str]:
    """The first characters in hexadecimal, a text for what lies between two silences."""
    pieces: list[bytearray] = []
    before = None
    for (value, _, _), start, end in chars:
        if before is None or start - before > 3 * (end - start):
            if len(pieces) == _SHOWN:
                break
            pieces.append(bytearray())
        if len(pieces[-1]) < SHOWN_CHARS:
            pieces[-1].append(value)
        before = end
    return [bytes(piece).hex(" ") for piece in pieces]


def is_tcp(piece: str) -> bool:
    """Whether a piece is of Modbus TCP: transaction, protocol 0, length and so many bytes, over and over.

    Source: MODBUS Messaging on TCP/IP Implementation Guide V1.0b, section 3.1.3.
    """
    data, at = bytes.fromhex(piece), 0
    while at + 8 <= len(data) and data[at + 2 : at + 4] == bytes(2):
        at += 6 + int.from_bytes(data[at + 4 : at + 6], "big")
    return at == len(data) or (at > len(data) == SHOWN_CHARS)
