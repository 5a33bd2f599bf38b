"""A port's words and bits in device memory, and its share of M8063."""

from collections import deque

from bussim.engines.modbus.codes import PortError
from bussim.plc.errors import SerialErrors
from bussim.plc.memory import Device, Memory
from bussim.plc.ports.events import PortErrorRaised, PortEvent


class PortStatus:
    """What one port shows its program, from RUN to STOP; offsets are those of CPAVL's tables."""

    __slots__ = ("_bits", "_errors", "_shown", "_words", "events", "memory", "port")

    def __init__(
        self,
        port: str,
        memory: Memory,
        devices: tuple[Device, Device],
        errors: SerialErrors,
        events: deque[PortEvent],
    ) -> None:
        self.port = port
        self.memory = memory
        #: Events that wait to be reported.
        self.events = events
        self._words, self._bits = devices
        self._shown = memory.bits(self._bits.letter)
        self._errors = errors

    def bit(self, offset: int) -> int:
        """A bit of the port, as the program left it."""
        return self.memory.get(Device(self._bits.letter, self._bits.address + offset))

    def set_bit(self, offset: int, value: int) -> None:
        """Show a bit of the port."""
        self._shown[self._bits.address + offset] = 1 if value else 0

    def set_word(self, offset: int, value: int) -> None:
        """Show a word of the port."""
        self.memory.set_word(self._words.letter, self._words.address + offset, value)

    def failed(self, error: PortError, now: int, text: str = "") -> None:
        """The port raises 7xyy."""
        code = self._errors.report(self.port, self.port, error)
        self.events.append(PortErrorRaised(now, self.port, error, code, text))

    def good(self) -> None:
        """What the port had raised is over: M8063 goes off unless something else keeps it on (assumed)."""
        self._errors.over(self.port)
