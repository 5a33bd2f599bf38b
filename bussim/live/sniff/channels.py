"""Finds the line in the channels of a session: which of them, its rate, polarity, format and protocol."""

from collections.abc import Iterator, Sequence
from itertools import pairwise, takewhile
from typing import Any

from bussim.line.characters import CharFormat, LineTiming
from bussim.live.arrival import Timed
from bussim.live.recordings.sigrok import LEAST_SAMPLES, SigrokFile, merged
from bussim.live.recordings.source import Chunk, LineSetup
from bussim.live.recordings.waveform import Receiver, measure
from bussim.live.sniff.heard import Heard, LineProtocol
from bussim.live.sniff.reading import Reading, Settings, pieces_of, read

#: Formats that are tried; of two stop bits it is decided afterwards.
_FORMATS = tuple(map(CharFormat.parse, ("8N1", "8E1", "8O1", "7E1", "7O1", "7N1")))
#: A channel with fewer edges is named, but not tried.
_LEAST_EDGES = 20
#: Characters that are read in every format and protocol. Where one has such a share of them in sound frames,
#: and none other half of it, it is the line's; else all that was surveyed decides.
_GLANCED, _CLEAR = 1500, 0.9
#: Several channels are one line if they give so many times the responses that one of them gives.
_FAR_MORE = 4
#: Two characters that are on a line at once have edges within so many bits.
_NEARBY = 12
#: What one of them drives has edges so many bits from the line's, also where others send at once.
_CLOSE = 3
#: Wrong bits that noise may make, as a share of characters.
_FEW_WRONG = 0.05


class Channels:
    """The channels of a session, surveyed once."""

    def __init__(self, source: SigrokFile) -> None:
        self._source = source
        self._channels = source.survey()
        self._measured = {
            name: measure(channel.edges, source.rate, source.samples)
            for name, channel in self._channels.items()
            if channel.total >= _LEAST_EDGES
        }
        self._known: dict[tuple[str, LineTiming, bool | None], list[Timed]] = {}
        self._readings: list[Reading] = []

    def best(self, settings: Settings) -> Reading:
        """The best reading: of a channel that has both directions, or of several with one each.

        Raises RecordingError where there is none, and the rate of a channel is beyond its samples.
        """
        names = settings.channels or tuple(self._channels)
        readings = [found for name in names for found in self._of_channel(name, settings)]
        self._readings = readings
        if not readings:
            rates = {name: settings.baud or self._rate_of(name) for name in names}
            for name, baud in rates.items():
                self._source.enough_samples(baud or 0, f"channel {name}: ")
            return Reading(
                settings.setup(settings.timing(None), inverted=bool(settings.inverted)), settings.protocol
            )
        best = max(
            readings, key=lambda each: (each.score.recognised, each.score.responses > 0, each.score.rank)
        )
        setup, protocol = best.setup, best.protocol
        alike = [
            each
            for each in readings
            if each.score.recognised and (each.setup[:2], each.protocol) == (setup[:2], protocol)
        ]
        said = len(settings.channels) > 1
        parts = list(settings.channels) if said else [each.setup.channels[0] for each in alike]
        if len(parts) < 2 or protocol is None:
            return best
        # Where one channel has both directions, others repeat a part of it, or are what its nodes drive: of
        # two that send at once more is sound on these than on the line.
        if not said:
            lines = [
                name
                for name in names
                if self._has_all(name, parts, _NEARBY * self._source.rate / setup.timing.baud)
            ]
            whole = [self._read(setup._replace(channels=(name,)), protocol)[0] for name in lines]
            whole = [
                each for each in whole if each.score.recognised
            ]  # else a clock, say, with edges everywhere
            if whole:
                return max(whole, key=lambda each: (each.score.responses, each.score.rank))
        alone, together = self._together(setup, protocol, [setup.channels[0], *parts])
        several = said or together.score.responses > _FAR_MORE * alone.score.responses
        return together if several else best

    def others(self, best: Reading) -> list[Reading]:
        """The readings of channels with a line of their own, beside the one that is read."""
        setup = best.setup
        near = _CLOSE * self._source.rate / setup.timing.baud
        return [
            each
            for each in self._readings
            if each.score.recognised and each.setup.channels[0] not in setup.channels
            if not any(self._has_all(name, each.setup.channels, near) for name in setup.channels)
        ]

    def _has_all(self, name: str, parts: Sequence[str], within: float) -> bool:
        """Whether a channel has edges within so many samples of those of several: they drive it."""
        import numpy as np

        own = self._channels[name].edges
        for part in parts:
            edges = self._channels[part].edges
            edges = edges[edges <= own.max(initial=-1)]
            near = np.searchsorted(own, edges + within) > np.searchsorted(own, edges - within)
            if not len(near) or near.mean() < _CLEAR:
                return False
        return True

    def _together(self, setup: LineSetup, protocol: LineProtocol, names: list[str]) -> list[Reading]:
        """The readings of the first channel and of all others as one line, of what was surveyed of all."""
        every = [self._chars(name, setup) for name in names]
        until = min(chars[-1][2] for chars in every if chars)
        every = [list(takewhile(lambda char: char[2] <= until, chars)) for chars in every]
        return [
            read(merged(chars), setup._replace(channels=channels), protocol, _ALL, wires=len(chars))[0]
            for channels, chars in ((setup.channels, every[:1]), (tuple(names[1:]), every[1:]))
        ]

    def enough_samples(self) -> None:
        """Raise RecordingError if the rate of a channel is beyond its samples: of one sample all is whole."""
        for name, found in self._measured.items():
            if found is not None and found.fits and 2 * found.baud <= self._source.rate:
                self._source.enough_samples(found.baud, f"channel {name}: ")

    def _rate_of(self, name: str) -> int | None:
        """The rate of a channel, if it is a standard one."""
        found = self._measured.get(name)
        return found.baud if found is not None and found.standard and found.fits else None

    def _of_channel(self, name: str, settings: Settings) -> Iterator[Reading]:
        """The best reading of a channel, if its samples suffice."""
        measured = self._measured.get(name)
        baud = settings.baud or (measured.baud if measured and measured.fits else None)
        if measured is None or baud is None or self._source.rate < LEAST_SAMPLES * baud:
            return
        inverted = measured.inverted if settings.inverted is None else settings.inverted
        self._known.clear()  # of one channel at a time, lest they fill the memory
        tried = [
            (settings.setup(timing, (name,), inverted=level), protocol)
            for level in ([False, True] if inverted is None else [inverted])
            for form in _FORMATS
            if settings.allows(form)
            for timing in [LineTiming(baud, with_stops(form, settings.stop_bits or 1))]
            for protocol in ([settings.protocol] if settings.protocol else _speaks(form))
        ]
        glanced = [self._read(*each, _GLANCED)[0].score for each in tried]
        shares = sorted(each.sound_characters / max(1, each.characters) for each in glanced)
        if len(tried) > 1 and shares[-1] >= _CLEAR and shares[-2] <= _CLEAR / 2:
            tried = [max(zip(glanced, tried, strict=True), key=lambda each: each[0].rank)[1]]
        if tried:
            best, sound = max((self._read(*each) for each in tried), key=lambda each: each[0].score.rank)
            yield best if settings.stop_bits else self._stop_bits(best, sound)

    def _chars(self, name: str, setup: LineSetup) -> list[Timed]:
        """The characters of the edges of a channel by which a line is found."""
        known = self._known.get((name, *setup[:2]))
        if known is not None:
            return known
        channel = self._channels[name]
        edges = channel.edges
        until = self._source.samples if channel.total == len(edges) else int(edges[-1])
        receiver = Receiver(setup.timing, self._source.rate, inverted=bool(setup.inverted))
        return self._known.setdefault((name, *setup[:2]), receiver.feed(edges, until))

    def _read(
        self, setup: LineSetup, protocol: LineProtocol, limit: int | None = None
    ) -> tuple[Reading, list[Heard]]:
        return read([Chunk(self._chars(setup.channels[0], setup)[:limit])], setup, protocol, _ALL)

    def _stop_bits(self, best: Reading, sound: Sequence[Heard]) -> Reading:
        """The reading with two stop bits, if no character of a sound frame begins before they are over."""
        timing = best.setup.timing
        chars = self._chars(best.setup.channels[0], best.setup)
        frames = iter(sound)
        frame, apart = next(frames, None), []
        for (_, start, end), (_, after, _) in pairwise(chars):
            while frame is not None and start >= frame.end:
                frame = next(frames, None)
            if frame is not None and frame.start <= start and end < frame.end:
                apart.append(after - start)
        if not apart or min(apart) < timing.bits(timing.format.bits) + timing.bits(1) // 2:
            return best
        two = LineTiming(timing.baud, with_stops(timing.format, 2))
        return Reading(best.setup._replace(timing=two), best.protocol, best.score)

    def likeliest(self, settings: Settings) -> LineSetup | None:
        """How the channel with the most edges is read where no protocol is recognised.

        Others of its rate and polarity are read with it, one a direction, unless it has the edges of all.
        None: there is none, or its samples are too few for a line of that rate. Of formats with hardly a
        wrong bit one with parity is likelier: by chance a line does not have it.
        """
        names = [name for name in settings.channels or self._channels if name in self._measured]
        name = max(names, key=lambda name: self._channels[name].total, default="")
        measured = self._measured.get(name)
        if measured is None:
            return None
        inverted = measured.inverted if settings.inverted is None else settings.inverted
        baud = settings.baud or measured.baud
        if self._source.rate < LEAST_SAMPLES * baud:
            return None
        forms = [form for form in _FORMATS if settings.allows(form)] or [settings.format(_FORMATS[0])]
        likely: dict[tuple[bool, bool, float], LineSetup] = {}
        for form in forms:
            setup = settings.setup(LineTiming(baud, form), (name,), inverted=bool(inverted))
            share, _ = self._wrong(name, setup)
            likely.setdefault((share > _FEW_WRONG, form.parity == "N", share), setup)
        alike = [each for each in names if (found := self._measured[each]) and found[:3] == measured[:3]]
        if len(settings.channels) > 1:
            alike = list(settings.channels)
        elif self._has_all(name, alike, _NEARBY * self._source.rate / baud):
            alike = [name]
        return likely[min(likely)]._replace(channels=tuple(alike))

    def _wrong(self, name: str, setup: LineSetup) -> tuple[float, list[Timed]]:
        """The share of characters with a wrong bit, and the characters."""
        chars = self._chars(name, setup)
        wrong = sum(not (char.parity_ok and char.stop_ok) for char, _, _ in chars)
        return (wrong / len(chars) if chars else 1.0), chars

    def described(self) -> list[dict[str, Any]]:
        """What is known of every channel where nothing is recognised."""
        return [self._described(name) for name in self._channels]

    def _described(self, name: str) -> dict[str, Any]:
        found: dict[str, Any] = {"channel": name, "edges": self._channels[name].total}
        measured = self._measured.get(name)
        if measured is None:
            return found
        inverted, tried = bool(measured.inverted), []
        for form in _FORMATS:
            share, chars = self._wrong(name, LineSetup(LineTiming(measured.baud, form), inverted))
            tried.append((share, str(form), chars))
        tried.sort(key=lambda each: each[0])
        return found | {
            "idle_level": int(not inverted),
            "baud": measured.baud,
            "samples_a_bit": round(self._source.rate / measured.baud, 2),
            "characters": len(tried[0][2]),
            "wrong_share": {form: round(share, 4) for share, form, _ in tried[:3]},
            "pieces": pieces_of(tried[0][2]),
        }


#: More characters than there are.
_ALL = 1 << 40


def with_stops(form: CharFormat, stop_bits: int) -> CharFormat:
    """A format with other stop bits."""
    return CharFormat(form.data_bits, form.parity, stop_bits)


def _speaks(form: CharFormat) -> list[LineProtocol]:
    """The protocols that have characters of a format: RTU eight bits, the others seven, ASCII also 8N."""
    if form.data_bits == 7:
        return [LineProtocol.NN, LineProtocol.ASCII]
    return [LineProtocol.RTU, *([LineProtocol.ASCII] if form.parity == "N" else [])]
