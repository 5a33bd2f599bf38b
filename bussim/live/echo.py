"""What a port receives of what it sends itself, as some RS485 adapters do."""

from bussim.engines.modbus.adu import Adu
from bussim.engines.modbus.pdu import WRITE_ONE
from bussim.engines.nn.frames import Frame
from bussim.live.options import CHUNK
from bussim.live.wire import Wire

#: So many responses to writes come back in a row from an adapter, and hardly from a master (assumed).
_IN_A_ROW = 10
#: Ports whose other side is a program, and no adapter.
_PROGRAMS = ("pty", "listen:")
#: Said of a port on which what is sent comes back.
RETURNS = "returns what is sent, as some adapters do: use --echo"


class Echo:
    """Leaves out of what is received on a wire what was sent on it.

    With the option ``echo`` that is as many characters as were sent. Without it a frame that comes back
    whole shows the adapter, is reported, and is left out from then on: a link's, a request, or a response
    that no request equals. A write whose response equals it must come twice; a master may repeat it, so that
    such responses show the adapter when ten in a row come back as soon as the adapter may hand them over.
    """

    def __init__(self, wire: Wire) -> None:
        self._wire = wire
        self._sent = b""  # what is still to come back
        self._needed = self._seen = 0  # frames in a row that show the adapter
        self._until = 0
        #: Whether frames have come back without the option.
        self.found = False

    def sent(self, chars: bytes, frame: object, *, response: bool = False) -> None:
        """Take in characters that are sent now, and the frame that they are of, None for none.

        ``response``: it is a slave's.
        """
        wire = self._wire
        if not wire.connected:
            self._sent = b""  # nothing of it will come
        elif self.found or wire.options.echo:
            self._sent = (self._sent + chars)[-CHUNK:]
        else:
            self._sent, self._needed = self._returned(chars, frame, response=response)
            self._until = wire.clock.now() + wire.timing.characters(len(chars)) + wire.options.tolerance

    def _returned(self, chars: bytes, frame: object, *, response: bool) -> tuple[bytes, int]:
        """What comes back from an adapter alone, and how often in a row; 0 for nothing."""
        if not isinstance(frame, Adu):
            return chars, int(isinstance(frame, Frame))
        if frame.pdu[0] not in WRITE_ONE:
            return chars, 1
        if not response:
            return 2 * chars, 1  # once from the station
        return chars, _IN_A_ROW * (not self._wire.url.startswith(_PROGRAMS))

    def unsent(self, count: int = CHUNK) -> None:
        """The last ``count`` characters will not come, all of them if none is given."""
        self._sent = self._sent[: max(0, len(self._sent) - count)]

    def without(self, data: bytes) -> bytes:
        """What was received, without what was sent."""
        own, blind = data[: len(self._sent)], self._wire.options.echo
        if not own:
            return data
        if not (blind or self._sent.startswith(own)):
            self._sent, self._seen = b"", 0
            return data
        self._sent = self._sent[len(own) :]
        return data[len(own) :] if blind or self._shown() else data

    def _shown(self) -> bool:
        """Whether it is known by now that the adapter returns what is sent."""
        if self.found or self._sent:
            return self.found
        in_time = self._needed == 1 or self._wire.clock.now() <= self._until
        self._seen = self._seen + 1 if in_time else 0
        self.found = 0 < self._needed <= self._seen
        if self.found:
            self._wire.report(f"{self._wire.url} {RETURNS}")
        return self.found
