"""The buses of a scenario that could be read, with the rate and format of each."""

from collections.abc import Iterable
from dataclasses import dataclass

from bussim.line.characters import NN_LINE, CharFormat, LineTiming
from bussim.line.protocols import BusProtocol
from bussim.scenario.schema.document import BusIn
from bussim.scenario.schema.draft import Entry, readable

#: The ports' own rate and format (PW10, section 5), for a bus that gives none.
PLAIN_LINE = LineTiming(9600, CharFormat(8, "N", 1))


@dataclass(frozen=True, slots=True)
class Line:
    """One bus: its entry, what that says, and the rate and format that follow."""

    entry: Entry[BusIn]
    bus: BusIn
    timing: LineTiming

    @property
    def name(self) -> str:
        """The name of the bus."""
        return self.bus.name

    @property
    def is_link(self) -> bool:
        """Whether it is an N:N link."""
        return self.bus.protocol is BusProtocol.NN


def lines_of(entries: Iterable[Entry[BusIn]]) -> dict[str, Line]:
    """The buses by name."""
    return {bus.name: Line(entry, bus, _timing(bus)) for entry, bus in readable(entries)}


def _timing(bus: BusIn) -> LineTiming:
    if bus.protocol is BusProtocol.NN:
        return NN_LINE
    return LineTiming(bus.baud or PLAIN_LINE.baud, bus.format or PLAIN_LINE.format)
